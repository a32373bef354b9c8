"""Live belief about pushed objects: a dual filter over any model that predicts pushes."""

"""Graph network that predicts pushes: forward pass in numpy, training in torch."""

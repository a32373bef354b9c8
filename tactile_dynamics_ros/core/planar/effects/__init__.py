"""What the model of a pushed object may lack, by name."""

"""What a model has to give so that it can be questioned."""

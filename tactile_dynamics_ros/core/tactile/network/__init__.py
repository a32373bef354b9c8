"""Networks that turn tared BioTac signals into force: inference in numpy, training in torch."""

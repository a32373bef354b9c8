"""Laws that no catalogue has, learnt from what a model leaves."""

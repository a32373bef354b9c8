"""Accuracy, honesty and cost of the inertial estimators, side by side."""

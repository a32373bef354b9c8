"""Friction of the held object's surface: probing with one finger, slip, and what they tell."""

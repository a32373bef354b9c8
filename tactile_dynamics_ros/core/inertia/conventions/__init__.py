"""Other readings of a recording: units, signs, axes and orders that people mistake."""

"""Two parts beside each other: outlines, relative motion, friction of each."""

"""What a verdict rests on beside the search: traces that do not matter, most that is explained."""

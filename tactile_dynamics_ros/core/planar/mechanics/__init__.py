"""Motion of links on a support with Coulomb friction, under a tip or a grip."""

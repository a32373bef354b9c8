"""Mass, friction and centre of mass of links from recorded pushes and pulls."""

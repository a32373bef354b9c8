"""What earlier recordings of a pushed object told, together with a new one."""

"""Laws that no catalogue has: forms that are searched, what is learnt, and its file of effects."""

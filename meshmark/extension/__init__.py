"""What a plugin sees of the core: protocols, hooks, and how plugins are found and chosen."""

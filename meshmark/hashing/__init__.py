"""Message authentication codes of very many keys."""

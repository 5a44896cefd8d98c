"""Reads sources nobody trusts in a process of its own, whose crash or hang costs one line."""

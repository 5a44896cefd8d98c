"""Marks assets, attacks the copies, verifies them blindly, and reports beside published figures."""

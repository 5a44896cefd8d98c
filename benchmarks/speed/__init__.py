"""What `speed_table.py` measures."""

"""Files on disk: atomic writes, text, tables and images."""

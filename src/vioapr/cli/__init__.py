"""The command line: one thin module a verb, one place where errors become one line."""

from vioapr.cli.main import main

__all__ = ["main"]

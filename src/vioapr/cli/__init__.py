"""The command line: one thin module a verb, which parses, calls and prints.

- `verbs`: the table of verbs; `main`: from words to a verb, and errors in one line.
- `parameters`, `parsing`, `help`, `suggestions`: a verb's flags: read, explained, corrected.
- `flags`, `method_params`: names of flags, and those of the methods' parameters.
- `console`: plain lines and progress bars.
"""

from vioapr.cli.main import main

__all__ = ["main"]

"""Foreign trajectory formats, one module each; conventions are converted here only."""

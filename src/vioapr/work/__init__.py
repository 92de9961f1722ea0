"""Long work: steps that resume, child processes, progress."""

"""Long work: steps that resume, locks of folders, progress, child processes."""

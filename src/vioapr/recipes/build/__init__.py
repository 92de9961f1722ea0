"""From a scene to a localizer in one go: every step, resumable, and a report of what came out."""

"""Pages and figures: what people look at."""

"""From fused walks to metrics, tables, figures and a report."""

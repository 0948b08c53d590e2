"""Association, alignment, metrics, statistics, tables, figures and the HTML page."""

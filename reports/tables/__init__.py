"""Tables of scores as Markdown, CSV and LaTeX, from the same cells.

In: scores. Out: text. Imports scoring and statistics.
"""

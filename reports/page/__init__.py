"""The report's page: it opens from disk, sorts, and goes through the frames.

In: runs, figures and tables. Out: HTML, pictures and animations. Imports figures and tables.
"""

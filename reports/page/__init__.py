"""The report's page: opens from disk, sorts its tables, steps through frames.

In: runs, figures and tables. Out: HTML, pictures and animations. Imports figures, tables and scoring.
"""

"""The report's HTML pages, which open from disk, with sortable tables and a frame scrubber.

In: runs, figures and tables. Out: HTML, pictures and animations. Imports figures, tables and scoring.
"""

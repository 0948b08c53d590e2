"""The regression gate: statistical decision whether results are worse than a baseline.

In: two folders of scores, or two versions of a repository. Out: pass, fail or inconclusive, with the findings.
Imports config, external trackers, inputs and runner, and the scores and statistics of reports.
"""

"""Challenges: packages of a suite's sequences without ground truth, and the scores of what comes back.

In: a suite and a secret. Out: a package, the organizer's folder.
Imports the runner, the suite's config, job folders and reports.
"""

"""Challenges: packages of a suite's sequences without ground truth, and the scoring of submissions.

In: a suite and a secret; later, submissions. Out: a package, the organizer's folder, scores of submissions.
Imports the runner, the suite's config, job folders and reports.
"""

"""Third-party trackers (ViSP, OpenCV contrib): baselines that run as separate programs and are never imported.

In: what is installed. Out: trackers, or the reason why one is unavailable. Imports external trackers.
"""

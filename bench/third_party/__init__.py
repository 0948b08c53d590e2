"""Third-party trackers (ViSP, OpenCV contrib): programs that run beside ours and are never imported.

In: what is installed. Out: trackers, or why they are absent. Imports external trackers.
"""

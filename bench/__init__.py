"""Config, the job graph (render -> track -> score -> report) and the command line."""

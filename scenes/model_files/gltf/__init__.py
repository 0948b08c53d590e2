"""What a glTF file has beside its triangles: images that it embeds, and features that its reader would leave out.

In: a file's header and content. Out: an error that names what cannot be read. Imports the limits of files and images.
"""

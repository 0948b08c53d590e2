"""Steps of light fitted to the pixels about an edge, and the optics that they tell of.

In: an image, the pixels and normals of edges that lie together, the optics. Out: where the step is, its variance, what
it tells of the optics. Imports the columns of edges.
"""

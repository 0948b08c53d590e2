"""The gallery of the docs: `python -m uavbench.bench.gallery DIR` draws every plug-in that has something to show.

In: the registries, and `examples.toml` with the parameters that show a plug-in best. Out: DIR/gallery.md and the
pictures in DIR/gallery; `docs_pictures` draws those of docs/images. Imports config, filming, the twin, the closed
loop's camera, rendering, flights and drawing.
"""

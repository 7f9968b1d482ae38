"""What schemathesis sends as a mesh: now and then one that can be planned on, so that chains get beyond the upload."""

from base64 import b64encode

import schemathesis
from hypothesis import strategies as st

CORNERS = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [
    (0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4),
    (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5),
]


def cube(edge: int) -> bytes:
    """A closed cube as ASCII STL."""
    lines = ["solid cube"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(str(c * edge) for c in CORNERS[corner]) for corner in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube", ""]).encode()


# Patterns of headers are not kept to in every phase; formats are.
schemathesis.openapi.format(
    "content-digest",
    st.binary(min_size=32, max_size=32).map(lambda digest: f"sha-256=:{b64encode(digest).decode()}:"),
)
schemathesis.openapi.media_type(
    "application/octet-stream",
    st.one_of(st.integers(min_value=5, max_value=60).map(cube), st.binary(max_size=200)),
)


@schemathesis.deserializer("application/octet-stream", "model/gltf-binary", "text/markdown")
def as_it_is(_context, response):
    """Bytes and prose have no structure to check beyond their type."""
    return response.content.decode("latin-1")

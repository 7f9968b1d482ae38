"""What schemathesis makes up beyond the OpenAPI document: now and then a mesh that can be planned on, and the id of one
that is there, so that chains get beyond the upload. Run as a program it uploads that one, and prints its id."""

import json
import os
import sys
import urllib.request
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


schemathesis.openapi.media_type(
    "application/octet-stream",
    st.one_of(st.integers(min_value=5, max_value=60).map(cube), st.binary(max_size=200)),
)
# Patterns of headers are not kept to in every phase; formats are.
schemathesis.openapi.format(
    "content-digest",
    st.binary(min_size=32, max_size=32).map(lambda digest: f"sha-256=:{b64encode(digest).decode()}:"),
)
if mesh := os.environ.get("VANTAGE_ORACLE_MESH"):
    schemathesis.openapi.format("uuid", st.one_of(st.just(mesh), st.uuids().map(str)))


@schemathesis.deserializer("application/octet-stream", "model/gltf-binary", "text/markdown")
def as_it_is(_context, response):
    """Bytes and prose have no structure to check beyond their type."""
    return response.content.decode("latin-1")


if __name__ == "__main__":
    address, key = sys.argv[1:]
    request = urllib.request.Request(f"{address}/api/v1/meshes?unit=mm", data=cube(20))
    request.add_header("Authorization", f"Bearer {key}")
    print(json.load(urllib.request.urlopen(request))["id"])

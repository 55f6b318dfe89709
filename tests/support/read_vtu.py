#!/usr/bin/env python3
"""Reads a VTK unstructured grid (.vtu, appended base64) by Python's own XML and base64 readers, knowing
only "VTK XML Formats", and prints it as JSON: points, cells with their corners, cell data."""
import base64
import json
import struct
import sys
import xml.etree.ElementTree

FORMATS = {"Float32": "f", "Int64": "q", "UInt16": "H", "UInt8": "B"}

root = xml.etree.ElementTree.parse(sys.argv[1]).getroot()
assert root.tag == "VTKFile" and root.get("type") == "UnstructuredGrid"
assert root.get("byte_order") == "LittleEndian" and root.get("header_type") == "UInt64"
appended = root.find("AppendedData")
assert appended.get("encoding") == "base64"
text = appended.text.strip()
assert text.startswith("_")
text = text[1:]


def values(array):
    assert array.get("format") == "appended"
    begin = int(array.get("offset"))
    (size,) = struct.unpack("<Q", base64.b64decode(text[begin:begin + 12])[:8])
    digits = (8 + size + 2) // 3 * 4
    data = base64.b64decode(text[begin:begin + digits], validate=True)[8:]
    assert len(data) == size
    kind = FORMATS[array.get("type")]
    flat = list(struct.unpack(f"<{size // struct.calcsize(kind)}{kind}", data))
    width = int(array.get("NumberOfComponents"))
    return flat if width == 1 else [flat[i:i + width] for i in range(0, len(flat), width)]


piece = root.find("UnstructuredGrid/Piece")
cells = {array.get("Name"): values(array) for array in piece.findall("Cells/DataArray")}
points = values(piece.find("Points/DataArray"))
assert len(points) == int(piece.get("NumberOfPoints"))
count = int(piece.get("NumberOfCells"))
assert len(cells["offsets"]) == len(cells["types"]) == count
ends = [0] + cells["offsets"]
corners = [cells["connectivity"][ends[i]:ends[i + 1]] for i in range(count)]
data = {array.get("Name"): values(array) for array in piece.findall("CellData/DataArray")}
assert all(len(list_) == count for list_ in data.values())
json.dump({"points": points, "types": cells["types"], "corners": corners, "data": data}, sys.stdout)

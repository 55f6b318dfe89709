#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"

namespace alhazen {

/// Reads a triangle mesh: PLY (ascii, binary little and big endian), OBJ, OFF, STL (ascii, binary;
/// equal corners are merged). Polygons are split into fans. Units are as in the file. Chosen by the
/// file's extension. Hostile input welcome: never allocates more than a small multiple of the file.
/// Fails: unavailable (cannot be read), unsupported (extension, list types), invalid with the line
/// or
///        byte where the text stops making sense, index out of range, number not finite.
[[nodiscard]] Result<Mesh> read_mesh(const std::filesystem::path& file);

/// The same from memory; `format` is "ply", "obj", "off" or "stl".
[[nodiscard]] Result<Mesh> parse_mesh(std::string_view bytes, std::string_view format);

/// Writes PLY (binary; all per-vertex lists), OBJ (with normals) or binary STL by extension:
/// written aside, synced, renamed. Fails: unsupported (extension), exhausted (disk), unavailable
/// (folder).
[[nodiscard]] Status write_mesh(const Mesh& mesh, const std::filesystem::path& file);

}  // namespace alhazen

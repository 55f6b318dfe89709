#include "reconstruct/mesh_io/mesh_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>

#include <bit>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <random>

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// A folder of its own that goes away with the test.
class Folder {
 public:
  Folder() {
    std::string pattern = (fs::temp_directory_path() / "alhazen-mesh-XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] fs::path operator/(const std::string& name) const { return path_ / name; }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

Mesh tetrahedron() {
  Mesh mesh;
  mesh.vertices_mm = {
      {0, 0, 0}, {0.1, 0, 0}, {0, 1.0 / 3.0, 0}, {1e-7, -2.5e-300, 12.345678901234567}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  mesh.normals = {{-1, 0, 0}, {0.6F, 0.8F, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.consistency = {0, 0.25F, 0.5F, 1};
  mesh.observed = {1, 0, 1, 1};
  mesh.depth_sigma_mm = {0.001F, std::numeric_limits<float>::quiet_NaN(), 0.002F, 0.5F};
  return mesh;
}

double volume_of(const Mesh& mesh) {
  double volume = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    Eigen::Matrix3d corners;
    corners << mesh.vertices_mm[a], mesh.vertices_mm[b], mesh.vertices_mm[c];
    volume += corners.determinant() / 6;
  }
  return volume;
}

/// Edges that do not have exactly one partner in the other direction.
std::size_t open_edges(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  }
  std::size_t open = 0;
  for (const auto& [edge, count] : edges) {
    const auto partner = edges.find({edge.second, edge.first});
    if (count != 1 || partner == edges.end() || partner->second != 1) ++open;
  }
  return open;
}

void expect_fails(std::string_view bytes, std::string_view format, Code code,
                  const std::string& what) {
  const auto mesh = parse_mesh(bytes, format);
  ASSERT_FALSE(mesh) << format << ": " << bytes;
  EXPECT_EQ(name_of(mesh.error().code), name_of(code)) << mesh.error().text();
  EXPECT_THAT(mesh.error().what, HasSubstr(what));
}

TEST(MeshFile, PlyGivesEveryBitBack) {
  const Folder folder;
  const Mesh mesh = tetrahedron();
  ASSERT_TRUE(write_mesh(mesh, folder / "a mesh.ply"));
  const auto back = read_mesh(folder / "a mesh.ply");
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->vertices_mm, mesh.vertices_mm);
  EXPECT_EQ(back->triangles, mesh.triangles);
  EXPECT_EQ(back->normals, mesh.normals);
  EXPECT_EQ(back->consistency, mesh.consistency);
  EXPECT_EQ(back->observed, mesh.observed);
  ASSERT_EQ(back->depth_sigma_mm.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(std::bit_cast<std::uint32_t>(back->depth_sigma_mm[i]),
              std::bit_cast<std::uint32_t>(mesh.depth_sigma_mm[i]));
  }
  // Nothing is left aside.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

TEST(MeshFile, PlyWithoutExtrasHasNone) {
  const Folder folder;
  Mesh mesh;
  mesh.vertices_mm = tetrahedron().vertices_mm;
  mesh.triangles = tetrahedron().triangles;
  ASSERT_TRUE(write_mesh(mesh, folder / "m.PLY"));
  const auto back = read_mesh(folder / "m.PLY");
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->vertices_mm, mesh.vertices_mm);
  EXPECT_TRUE(back->normals.empty());
  EXPECT_TRUE(back->observed.empty());
}

TEST(MeshFile, ObjGivesPositionsAndNormalsBack) {
  const Folder folder;
  const Mesh mesh = tetrahedron();
  ASSERT_TRUE(write_mesh(mesh, folder / "m.obj"));
  const auto back = read_mesh(folder / "m.obj");
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->vertices_mm, mesh.vertices_mm);
  EXPECT_EQ(back->triangles, mesh.triangles);
  EXPECT_EQ(back->normals, mesh.normals);
}

TEST(MeshFile, StlGivesSinglePrecisionBackAndJoinsCorners) {
  const Folder folder;
  const Mesh mesh = tetrahedron();
  ASSERT_TRUE(write_mesh(mesh, folder / "m.stl"));
  const auto back = read_mesh(folder / "m.stl");
  ASSERT_TRUE(back) << back.error().text();
  ASSERT_EQ(back->vertices_mm.size(), 4U);
  EXPECT_EQ(open_edges(*back), 0U);
  EXPECT_NEAR(volume_of(*back), volume_of(mesh), 1e-8);
  // Vertices in order of appearance: 0 2 1 3.
  EXPECT_EQ(back->vertices_mm[1], mesh.vertices_mm[2].cast<float>().cast<double>());
  EXPECT_EQ(back->triangles[0], (std::array<std::uint32_t, 3>{0, 1, 2}));
}

TEST(MeshFile, ReplacesAFileWholly) {
  const Folder folder;
  std::ofstream(folder / "m.ply") << std::string(100000, 'x');
  ASSERT_TRUE(write_mesh(tetrahedron(), folder / "m.ply"));
  EXPECT_TRUE(read_mesh(folder / "m.ply"));
}

TEST(MeshFile, NamesWhatCannotBeWritten) {
  const Folder folder;
  const auto unknown = write_mesh(tetrahedron(), folder / "m.off");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, Code::unsupported);
  const auto missing = write_mesh(tetrahedron(), folder / "no such folder" / "m.ply");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, Code::unavailable);
  EXPECT_THAT(missing.error().where, HasSubstr("m.ply"));
}

TEST(MeshFile, RefusesWhatIsNoFile) {
  const Folder folder;
  const auto missing = read_mesh(folder / "m.ply");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, Code::unavailable);
  EXPECT_FALSE(read_mesh(folder.path()));
  ASSERT_EQ(::system(("mkfifo '" + (folder / "p.ply").string() + "'").c_str()), 0);
  const auto pipe = read_mesh(folder / "p.ply");  // returns although nobody writes
  ASSERT_FALSE(pipe);
  EXPECT_EQ(pipe.error().code, Code::unavailable);
}

TEST(Ply, ReadsAnyOrderOfPropertiesListsAndElements) {
  const std::string text =
      "ply\r\nformat ascii 1.0\ncomment made by hand\nobj_info none\n"
      "element camera 2\nproperty list uchar float poses\nproperty double f\n"
      "element face 2\nproperty uchar red\nproperty list int short vertex_index\n"
      "property list uchar float texcoord\n"
      "element vertex 5\nproperty float nz\nproperty double z\nproperty list char int seen_by\n"
      "property float y\nproperty int x\nproperty float ny\nproperty float nx\n"
      "element void 1000000000000\n"
      "end_header\n"
      "2 0.5 nan 3\n0 7\n"
      "255 4 0 1 2 3 2 0.5 0.5\n7 3 0 1\n4 0\n"
      "1 30 2 5 6 20 10 0 0\n1 31 0 21 +11 0 0 1 32 0 22 12 0 0 1 33 0 23 13 0 0\n"
      "1 34e0 1 1 24 -14 0 0.5";
  const auto mesh = parse_mesh(text, "ply");
  ASSERT_TRUE(mesh) << mesh.error().text();
  ASSERT_EQ(mesh->vertices_mm.size(), 5U);
  EXPECT_EQ(mesh->vertices_mm[0], Eigen::Vector3d(10, 20, 30));
  EXPECT_EQ(mesh->vertices_mm[4], Eigen::Vector3d(-14, 24, 34));
  EXPECT_EQ(mesh->normals[4], Eigen::Vector3f(0.5F, 0, 1));
  const std::vector<std::array<std::uint32_t, 3>> fan = {{0, 1, 2}, {0, 2, 3}, {0, 1, 4}};
  EXPECT_EQ(mesh->triangles, fan);
}

/// The same mesh in all four codings must read the same; big endian is made by hand here.
TEST(Ply, ReadsBigEndian) {
  std::string bytes =
      "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty double y\n"
      "property short z\nelement face 1\nproperty list ushort uint vertex_indices\nend_header\n";
  const auto append = [&bytes](auto value) {
    std::string raw(sizeof(value), '\0');
    std::memcpy(raw.data(), &value, sizeof(value));
    bytes.append(raw.rbegin(), raw.rend());
  };
  for (int i = 0; i < 3; ++i) {
    append(0.5F + static_cast<float>(i));
    append(1e-3 * i);
    append(static_cast<std::int16_t>(-i));
  }
  append(std::uint16_t{3});
  for (const std::uint32_t corner : {2U, 1U, 0U}) append(corner);
  const auto mesh = parse_mesh(bytes, "ply");
  ASSERT_TRUE(mesh) << mesh.error().text();
  EXPECT_EQ(mesh->vertices_mm[2], Eigen::Vector3d(2.5, 2e-3, -2));
  EXPECT_EQ(mesh->triangles[0], (std::array<std::uint32_t, 3>{2, 1, 0}));
}

const std::string kPlyStart =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

TEST(Ply, NamesTheLineThatMakesNoSense) {
  expect_fails("", "ply", Code::invalid, "line 1");
  expect_fails("ply\n", "ply", Code::invalid, "end_header");
  expect_fails("ply\nformat ascii 1.0\nelement vertex -3\n", "ply", Code::invalid, "line 3");
  expect_fails("ply\nformat morse 1.0\n", "ply", Code::invalid, "morse");
  expect_fails("ply\nproperty float x\n", "ply", Code::invalid, "before any element");
  expect_fails("ply\nelement face 1\nproperty list float int vertex_indices\n", "ply",
               Code::unsupported, "count");
  expect_fails("ply\nelement face 1\nproperty list uchar float vertex_indices\n", "ply",
               Code::unsupported, "integer");
  expect_fails("ply\nelement face 1\nproperty half x\n", "ply", Code::invalid, "half");
  expect_fails("ply\nelement vertex 1\nelement vertex 1\n", "ply", Code::invalid, "second");
  expect_fails("ply\nelement vertex 1\nproperty float x\nproperty int x\n", "ply", Code::invalid,
               "line 4");
  expect_fails("ply\nelement vertex 4294967295\nend_header\n", "ply", Code::invalid, "line 2");
  expect_fails("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "ply",
               Code::invalid, "x, y and z");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n", "ply", Code::invalid, "line 12");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1e999 0\n3 0 1 2\n", "ply", Code::invalid, "finite");
  expect_fails(kPlyStart + "0 0 0\n1 0 zero\n0 1 0\n3 0 1 2\n", "ply", Code::invalid, "\"zero\"");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "ply", Code::invalid, "vertex 3");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "ply", Code::invalid, "-1");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "ply", Code::invalid, "2 corners");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1 0\n-3 0 1\n", "ply", Code::invalid, "-3 corners");
  expect_fails(kPlyStart + "0 0 0\n1 0 0\n0 1 0\n300000000000 0 1 2\n", "ply", Code::invalid,
               "too early");
  EXPECT_TRUE(parse_mesh(kPlyStart + "0 0 0\n1 0 0\n0 1e-999 0\n3 0 1 2", "ply"));
}

TEST(Ply, SinglePrecisionHoldsWhatIsKeptInIt) {
  for (const char* name : {"nx", "consistency", "depth_sigma_mm"}) {
    const std::string head = std::string("ply\nformat ascii 1.0\nelement vertex 1\n") +
                             "property float x\nproperty float y\nproperty float z\n" +
                             "property double " + name + "\nproperty float ny\n" +
                             "property float nz\nelement face 0\n" +
                             "property list uchar int vertex_indices\nend_header\n";
    EXPECT_TRUE(parse_mesh(head + "0 0 0 1e38 0 0\n", "ply")) << name;
    EXPECT_EQ(parse_mesh(head + "0 0 0 nan 0 0\n", "ply").operator bool(),
              std::string_view(name) == "depth_sigma_mm");
    expect_fails(head + "0 0 0 1e39 0 0\n", "ply", Code::invalid, "vertex 0");
  }
}

TEST(Ply, HugeCountsCostNothing) {
  for (const char* coded : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    for (const char* count : {"4294967294", "9223372036854775807"}) {
      const std::string format = std::string("ply\nformat ") + coded + " 1.0\n";
      const std::string vertex =
          "\nproperty double x\nproperty double y\nproperty double z\nelement face ";
      const std::string face = "\nproperty list uint int vertex_indices\nend_header\n";
      EXPECT_FALSE(parse_mesh(
          format + "element vertex " + count + vertex + "1" + face + std::string(999, '1'), "ply"));
      EXPECT_FALSE(parse_mesh(
          format + "element vertex 0" + vertex + count + face + std::string(999, '1'), "ply"));
      EXPECT_FALSE(parse_mesh(format + "element other " + count + "\nproperty int a\n" +
                                  "element vertex 0" + vertex + "0" + face + std::string(999, '1'),
                              "ply"));
      EXPECT_FALSE(parse_mesh(format + "element other " + count +
                                  "\nproperty list int double a\nelement vertex 0" + vertex + "0" +
                                  face + std::string(999, '\xff'),
                              "ply"));
    }
  }
}

TEST(Obj, ReadsCornersOfAllForms) {
  const auto mesh = parse_mesh(
      "# a comment\nmtllib x.mtl\no thing\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0\n"
      "vt 0 0\nvn 0 0 1\ns off\nusemtl none\n\n"
      "f 1/1/1 2/1/1 3/1/1 4/1/1 # a square\nf 1//1 2//1 \\\n  3//1\nf -4/1/-1 -3//1 -1//1\r\n",
      "obj");
  ASSERT_TRUE(mesh) << mesh.error().text();
  const std::vector<std::array<std::uint32_t, 3>> triangles = {
      {0, 1, 2}, {0, 2, 3}, {0, 1, 2}, {0, 1, 3}};
  EXPECT_EQ(mesh->triangles, triangles);
  ASSERT_EQ(mesh->normals.size(), 4U);
  EXPECT_EQ(mesh->normals[2], Eigen::Vector3f(0, 0, 1));
}

TEST(Obj, DropsNormalsThatDifferAtOneVertex) {
  const auto mesh = parse_mesh(
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nvn 0 0 -1\nf 1//1 2//1 3//1\nf 1//2 3//1 2//1", "obj");
  ASSERT_TRUE(mesh) << mesh.error().text();
  EXPECT_TRUE(mesh->normals.empty());
}

TEST(Obj, NamesTheLineThatMakesNoSense) {
  expect_fails("v 0 0\n", "obj", Code::invalid, "line 1");
  expect_fails("v 0 0 inf\n", "obj", Code::invalid, "finite");
  expect_fails("vn 0 0 1e39\n", "obj", Code::invalid, "normal");
  expect_fails("v 0 0 0\nf 1 1 0\n", "obj", Code::invalid, "line 2");
  expect_fails("v 0 0 0\nf 1 1 2\n", "obj", Code::invalid, "vertex 1");
  expect_fails("v 0 0 0\nf 1 1 -2\n", "obj", Code::invalid, "index -2");
  expect_fails("v 0 0 0\nf 1 1 99999999999999999999\n", "obj", Code::invalid, "no index");
  expect_fails("v 0 0 0\nf 1 1\n", "obj", Code::invalid, "2 corners");
  expect_fails("v 0 0 0\nnonsense\n", "obj", Code::invalid, "nonsense");
  expect_fails(
      "v 0 0 0\n\x7f"
      "ELF\x01\n",
      "obj", Code::invalid, "?ELF?");
  expect_fails("# nothing\n", "obj", Code::invalid, "no vertices");
}

TEST(Off, ReadsCommentsNormalsAndColours) {
  const std::string rest =
      "# counts\n4 2 0\n0 0 0 0 0 1 0.1 0.2 0.3 1\n\n1 0 0 0 0 1\n1 1 0 0 0 1 # c\n0 1 0 0 0 1\n"
      "4 0 1 2 3 255 0 0\n3 0 1 3";
  for (const char* head : {"CNOFF\n", "NOFF ", "STCNOFF # comment\n"}) {
    const auto mesh = parse_mesh(head + rest, "off");
    ASSERT_TRUE(mesh) << head << mesh.error().text();
    EXPECT_EQ(mesh->triangles.size(), 3U);
    EXPECT_EQ(mesh->normals[3], Eigen::Vector3f(0, 0, 1));
  }
  EXPECT_TRUE(parse_mesh("OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "off"));
}

TEST(Off, NamesTheLineThatMakesNoSense) {
  expect_fails("PLY\n", "off", Code::invalid, "line 1");
  expect_fails("4OFF\n", "off", Code::unsupported, "4OFF");
  expect_fails("OFF BINARY\n", "off", Code::unsupported, "binary");
  expect_fails("OFF\n-1 0 0\n", "off", Code::invalid, "line 2");
  expect_fails("OFF\n4294967294 0 0\n", "off", Code::invalid, "do not fit");
  expect_fails("OFF\n0 9223372036854775807 0\n", "off", Code::invalid, "do not fit");
  expect_fails("OFF\n1 0 0\n0 0 nan\n", "off", Code::invalid, "line 3");
  expect_fails("NOFF\n1 0 0\n0 0 0 0 1e300 1\n", "off", Code::invalid, "line 3");
  expect_fails("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "off", Code::invalid, "vertex 1");
  expect_fails("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", "off", Code::invalid, "line 4");
  expect_fails("OFF\n1 1 0\n0 0 0\n5000000 0 0 0\n", "off", Code::invalid, "line 4");
}

TEST(Stl, ReadsText) {
  const auto mesh = parse_mesh(
      "solid a thing\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n"
      "   vertex 0 1e0 0\n  endloop\n endfacet\n facet normal 0 0 1\n  outer loop\n"
      "   vertex 1 0 0\n   vertex 1 1 0\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid a thing",
      "stl");
  ASSERT_TRUE(mesh) << mesh.error().text();
  EXPECT_EQ(mesh->vertices_mm.size(), 4U);
  EXPECT_EQ(mesh->triangles[1], (std::array<std::uint32_t, 3>{1, 3, 2}));
  expect_fails("solid\nfacet\nvertex 0 0 0\nvertex 0 0 0\nendfacet\nendsolid", "stl", Code::invalid,
               "line 5");
  expect_fails("solid\nfacet\nvertex 0 0 inf\n", "stl", Code::invalid, "line 3");
  expect_fails("solid\nfacet\nvertex 0 0 0\n", "stl", Code::invalid, "too early");
}

TEST(Stl, RefusesBinaryOfTheWrongLength) {
  std::string bytes(84, ' ');
  const std::uint32_t count = 0xffffffff;
  std::memcpy(bytes.data() + 80, &count, 4);
  expect_fails(bytes, "stl", Code::invalid, "4294967295 triangles");
  expect_fails(bytes.substr(0, 60), "stl", Code::invalid, "header");
}

TEST(MeshFile, UnknownFormatIsNamed) { expect_fails("", "fbx", Code::unsupported, "fbx"); }

/// Whatever byte a file ends at, or is changed at: an error or a mesh whose indices hold, and
/// never a mesh that pretends to be whole.
TEST(MeshFile, TruncationAtEveryByteIsAnError) {
  const Folder folder;
  for (const std::string format : {"ply", "stl"}) {
    const fs::path file = folder / ("m." + format);
    ASSERT_TRUE(write_mesh(tetrahedron(), file));
    const std::string whole = bytes_of(file);
    for (std::size_t size = 0; size < whole.size(); ++size)
      EXPECT_FALSE(parse_mesh(std::string_view(whole).substr(0, size), format)) << size;
  }
  const std::string off = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2";
  for (std::size_t size = 0; size < off.size(); ++size)
    EXPECT_FALSE(parse_mesh(std::string_view(off).substr(0, size), "off")) << size;
}

TEST(MeshFile, ChangedBytesNeverGiveAnIndexOutOfRange) {
  const Folder folder;
  std::mt19937 random(7);
  for (const std::string format : {"ply", "obj", "stl"}) {
    const fs::path file = folder / ("m." + format);
    ASSERT_TRUE(write_mesh(tetrahedron(), file));
    const std::string whole = bytes_of(file);
    for (int trial = 0; trial < 3000; ++trial) {
      std::string changed = whole;
      for (int k = 0; k < 3; ++k)
        changed[random() % changed.size()] = static_cast<char>(random() % 256);
      const auto mesh = parse_mesh(changed, format);
      if (!mesh) continue;
      for (const auto& triangle : mesh->triangles) {
        for (const auto corner : triangle) ASSERT_LT(corner, mesh->vertices_mm.size());
      }
    }
  }
}

struct RealMesh {
  const char* name;
  std::size_t vertices, triangles;
  bool is_closed;
  friend void PrintTo(const RealMesh& mesh, std::ostream* out) { *out << mesh.name; }
};

class RealMeshes : public ::testing::TestWithParam<RealMesh> {};

/// Meshes nobody on this project made; counts as their origins state them.
TEST_P(RealMeshes, ReadAsTheirOriginSays) {
  const char* given = std::getenv("ALHAZEN_DATA");
  const fs::path data = given != nullptr && *given != '\0'
                            ? fs::path(given)
                            : fs::path(ALHAZEN_SOURCE_DIR) / "../shared/data";
  const fs::path file = data / "meshes" / GetParam().name;
  if (!fs::exists(file)) GTEST_SKIP() << "missing: " << file;
  const auto mesh = read_mesh(file);
  ASSERT_TRUE(mesh) << mesh.error().text();
  EXPECT_EQ(mesh->vertices_mm.size(), GetParam().vertices);
  EXPECT_EQ(mesh->triangles.size(), GetParam().triangles);
  EXPECT_EQ(open_edges(*mesh) == 0, GetParam().is_closed);
  if (GetParam().is_closed) {
    EXPECT_GT(volume_of(*mesh), 0);
  }

  const Folder folder;
  for (const char* name : {"m.ply", "m.obj", "m.stl"}) {
    ASSERT_TRUE(write_mesh(*mesh, folder / name));
    const auto back = read_mesh(folder / name);
    ASSERT_TRUE(back) << back.error().text();
    EXPECT_EQ(back->triangles.size(), mesh->triangles.size()) << name;
    EXPECT_NEAR(volume_of(*back), volume_of(*mesh), 1e-5 * std::abs(volume_of(*mesh))) << name;
    if (std::string_view(name) != "m.stl") {
      EXPECT_EQ(back->vertices_mm, mesh->vertices_mm) << name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(MeshFile, RealMeshes,
                         ::testing::Values(RealMesh{"bun_zipper.ply", 35947, 69451, false},
                                           RealMesh{"bunny_closed.ply", 37706, 75408, true},
                                           RealMesh{"bunny00.off", 37706, 75408, true},
                                           RealMesh{"armadillo.off", 26002, 52000, true},
                                           RealMesh{"buddha_100k.obj", 49950, 100000, false},
                                           RealMesh{"spot.obj", 2930, 5856, true},
                                           RealMesh{"fandisk.obj", 6475, 12946, true},
                                           RealMesh{"rocker-arm.obj", 10044, 20088, true}));

}  // namespace
}  // namespace alhazen

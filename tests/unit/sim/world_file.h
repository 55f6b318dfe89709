#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include "drivers/sim/world.h"

namespace alhazen::sim {

inline std::filesystem::path shipped_world(const std::string& name) {
  return std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds" / (name + ".toml");
}

inline std::string text_of(const std::filesystem::path& file) {
  std::ostringstream out;
  out << std::ifstream(file).rdbuf();
  return out.str();
}

/// `text` with the first `from` replaced; the test fails where it is missing.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

/// Where pixel (x, y) of a picture lies that is `width` pixels wide.
inline std::size_t index_of(int x, int y, int width) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
         static_cast<std::size_t>(x);
}

/// A world file of its own for one test, removed with it.
class WorldFile {
 public:
  explicit WorldFile(const std::string& text)
      : path_(std::filesystem::path(testing::TempDir()) /
              ("world-" + std::to_string(getpid()) + "-" + std::to_string(++count_) + ".toml")) {
    std::ofstream(path_) << text;
  }
  ~WorldFile() { std::filesystem::remove(path_); }
  WorldFile(const WorldFile&) = delete;
  WorldFile& operator=(const WorldFile&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  static inline int count_ = 0;
  std::filesystem::path path_;
};

inline std::shared_ptr<World> make_world(const std::string& text) {
  const WorldFile file(text);
  auto scene = Scene::load(file.path());
  EXPECT_TRUE(scene) << scene.error().text();
  if (!scene) return nullptr;
  auto world = World::make(*std::move(scene));
  EXPECT_TRUE(world) << world.error().text();
  return world ? *world : nullptr;
}

}  // namespace alhazen::sim

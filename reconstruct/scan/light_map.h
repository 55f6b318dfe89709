#pragma once

#include <Imath/half.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "alhazen/image.h"
#include "reconstruct/scan/pixel_memory.h"
#include "reconstruct/scan/region.h"

namespace alhazen {

/// What a camera pixel saw of one display. Values are part of the file format.
enum class Label : std::uint8_t {
  none = 0,          ///< nothing that decodes
  mirror = 1,        ///< the display, by reflection
  direct_sight = 2,  ///< the display itself: free space along the whole ray
  mixed = 3,         ///< several positions at once: silhouettes, display edges
  saturated = 4,
  second_bounce = 5,  ///< by more than one reflection
};

/// Which light map: one display seen by one camera at one stop of the turntable.
struct StackKey {
  int stop = 0;
  std::string display, camera;
  friend bool operator==(const StackKey&, const StackKey&) = default;
  friend auto operator<=>(const StackKey&, const StackKey&) = default;
};

/// Memory of a light map's lists: take_pixels(), and resize(n) leaves new elements as they are, for
/// filling the lists of a large sensor twice takes as long as decoding it. Use resize(n, value) or
/// assign(n, value) for lists that are not written as a whole.
template <class T>
struct PixelAllocator {
  static_assert(std::is_trivially_copyable_v<T>);
  using value_type = T;
  static_assert(alignof(T) <= kPixelAlignment);

  PixelAllocator() = default;
  template <class Other>
  // NOLINTNEXTLINE(google-explicit-constructor): allocators convert
  PixelAllocator(const PixelAllocator<Other>& /*other*/) noexcept {}
  [[nodiscard]] T* allocate(std::size_t count) {
    if (count > std::numeric_limits<std::size_t>::max() / sizeof(T))
      throw std::bad_array_new_length();
    return static_cast<T*>(take_pixels(count * sizeof(T)));
  }
  void deallocate(T* list, std::size_t count) noexcept { give_pixels(list, count * sizeof(T)); }
  template <class Other, class... Arguments>
  void construct(Other* place, Arguments&&... arguments) {
    if constexpr (sizeof...(Arguments) == 0) {
      ::new (static_cast<void*>(place)) Other;
    } else {
      ::new (static_cast<void*>(place)) Other(std::forward<Arguments>(arguments)...);
    }
  }
  friend bool operator==(const PixelAllocator&, const PixelAllocator&) noexcept { return true; }
};
template <class T>
using PixelList = std::vector<T, PixelAllocator<T>>;

/// Per camera pixel, the display position whose light arrives there.
///
/// Thread: reentrant. Immutable after decoding.
/// Shape:  every list is region.height × region.width, row-major.
/// Frames: u right, v down in display pixels, centres at integers; NaN where the label is not
/// mirror
///         or direct_sight.
/// Source: Gray code with inverse patterns, decoded per pixel to the finest resolvable bit
///         (Weinmann, Osep, Ruiters, Klein, ICCV 2013).
struct LightMap {
  StackKey key;
  double angle_rad = 0;  ///< measured angle of the turntable
  Region region;         ///< where in the camera's sensor the lists lie
  PixelList<float> u_px, v_px;
  /// Standard deviations of u and v: half precision says them to 0.05 %, and decoding takes as long
  /// as its results are.
  PixelList<Imath::half> sigma_u_px, sigma_v_px;
  PixelList<std::uint8_t> contrast;  ///< white − black, 255 = full scale
  PixelList<Label> label;
  PixelList<std::uint8_t> bit_u, bit_v;  ///< finest Gray bit that was resolved, 0 = finest

  [[nodiscard]] std::size_t size_px() const noexcept { return pixel_count(region); }
  [[nodiscard]] bool has_whole_lists() const noexcept {
    const std::size_t size = size_px();
    return u_px.size() == size && v_px.size() == size && sigma_u_px.size() == size &&
           sigma_v_px.size() == size && contrast.size() == size && label.size() == size &&
           bit_u.size() == size && bit_v.size() == size;
  }
  /// All of them to the region's size; new elements are undefined.
  void resize_lists() {
    const std::size_t size = size_px();
    u_px.resize(size);
    v_px.resize(size);
    sigma_u_px.resize(size);
    sigma_v_px.resize(size);
    contrast.resize(size);
    label.resize(size);
    bit_u.resize(size);
    bit_v.resize(size);
  }
  [[nodiscard]] bool is_position(std::size_t pixel) const {
    return label[pixel] == Label::mirror || label[pixel] == Label::direct_sight;
  }
};

/// The part of a map that holds every label but none, at least one pixel: a mirror shows a display
/// in a small part of the picture, and the rest says nothing.
[[nodiscard]] LightMap cropped(const LightMap& map);

}  // namespace alhazen

#include "reconstruct/scan/pixel_memory.h"

#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <new>
#include <optional>

namespace alhazen {
namespace {

/// One entry of a page table for 512 pages: large lists are otherwise slowed by looking them up.
constexpr std::size_t kHugePageBytes = std::size_t{2} << 20;

std::align_val_t alignment_of(std::size_t bytes) {
  return std::align_val_t{bytes >= kHugePageBytes ? kHugePageBytes : kPixelAlignment};
}

struct Block {
  void* memory = nullptr;
  std::size_t bytes = 0;
};

/// Blocks given back, the oldest first. There is room for all that can be kept, for giving back
/// must not fail.
struct Kept {
  std::mutex lock;
  std::array<Block, kMostKeptBytes / kLeastKeptBytes> blocks;
  std::size_t count = 0, bytes = 0;
  std::size_t used_bytes = 0, most_used_bytes = 0;  ///< by blocks that could be kept

  void use(std::size_t more_bytes) {
    used_bytes += more_bytes;
    most_used_bytes = std::max(most_used_bytes, used_bytes);
  }
  /// The oldest that must go for `more_bytes` to be kept besides; called until there is none.
  std::optional<Block> surplus(std::size_t more_bytes) {
    const std::size_t most = std::min(kMostKeptBytes, most_used_bytes - used_bytes);
    if (count == 0 || bytes + more_bytes <= most) return std::nullopt;
    return remove(0);
  }

  Block remove(std::size_t i) {
    const Block block = blocks[i];
    std::move(blocks.begin() + static_cast<std::ptrdiff_t>(i) + 1,
              blocks.begin() + static_cast<std::ptrdiff_t>(count),
              blocks.begin() + static_cast<std::ptrdiff_t>(i));
    --count;
    bytes -= block.bytes;
    return block;
  }
};

/// Never destroyed: lists with static lifetime may outlive everything else.
Kept& kept() {
  static Kept& instance = *new Kept;
  return instance;
}

bool may_keep(std::size_t bytes) { return bytes >= kLeastKeptBytes && bytes <= kMostKeptBytes; }

void release(const Block& block) noexcept {
  ::operator delete(block.memory, alignment_of(block.bytes));
}

}  // namespace

void* take_pixels(std::size_t bytes) {
  if (may_keep(bytes)) {
    Kept& store = kept();
    const std::lock_guard hold(store.lock);
    store.use(bytes);
    // The youngest: it may still be in a cache.
    for (std::size_t i = store.count; i-- > 0;) {
      if (store.blocks[i].bytes == bytes) return store.remove(i).memory;
    }
    while (const auto oldest = store.surplus(0)) release(*oldest);
  }
  void* memory = nullptr;
  try {
    memory = ::operator new(bytes, alignment_of(bytes));
  } catch (const std::bad_alloc&) {
    // What was not had is not in use.
    if (may_keep(bytes)) {
      const std::lock_guard hold(kept().lock);
      kept().used_bytes -= bytes;
    }
    throw;
  }
  // A hint: where it is not followed, pages are small.
  if (bytes >= kHugePageBytes) ::madvise(memory, bytes, MADV_HUGEPAGE);
  return memory;
}

void give_pixels(void* block, std::size_t bytes) noexcept {
  if (!may_keep(bytes)) return release({block, bytes});
  Kept& store = kept();
  const std::lock_guard hold(store.lock);
  store.used_bytes -= bytes;
  while (const auto oldest = store.surplus(bytes)) release(*oldest);
  store.blocks[store.count++] = {block, bytes};
  store.bytes += bytes;
}

std::size_t kept_pixel_bytes() {
  Kept& store = kept();
  const std::lock_guard hold(store.lock);
  return store.bytes;
}

}  // namespace alhazen

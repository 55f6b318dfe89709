#include "reconstruct/scan/pixel_memory.h"

#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <new>

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

void release(const Block& block) noexcept {
  ::operator delete(block.memory, alignment_of(block.bytes));
}

}  // namespace

void* take_pixels(std::size_t bytes) {
  if (bytes >= kLeastKeptBytes) {
    Kept& store = kept();
    const std::lock_guard hold(store.lock);
    // The youngest: it may still be in a cache.
    for (std::size_t i = store.count; i-- > 0;) {
      if (store.blocks[i].bytes == bytes) return store.remove(i).memory;
    }
  }
  void* memory = ::operator new(bytes, alignment_of(bytes));
  // A hint: where it is not followed, pages are small.
  if (bytes >= kHugePageBytes) ::madvise(memory, bytes, MADV_HUGEPAGE);
  return memory;
}

void give_pixels(void* block, std::size_t bytes) noexcept {
  if (bytes < kLeastKeptBytes || bytes > kMostKeptBytes) return release({block, bytes});
  Kept& store = kept();
  const std::lock_guard hold(store.lock);
  while (store.bytes + bytes > kMostKeptBytes) release(store.remove(0));
  store.blocks[store.count++] = {block, bytes};
  store.bytes += bytes;
}

std::size_t kept_pixel_bytes() {
  Kept& store = kept();
  const std::lock_guard hold(store.lock);
  return store.bytes;
}

}  // namespace alhazen

#include "daemon/devices/entry_file.h"

#include <elf.h>

#include <bit>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "alhazen/driver.h"

namespace alhazen {
namespace {

constexpr std::string_view kSymbol = "alhazen_driver_entry";
/// Of a build tag or a name.
constexpr std::size_t kLongestText = 200;

/// The bytes of a module, read with bounds.
class Module {
 public:
  explicit Module(std::string bytes) : bytes_(std::move(bytes)) {}

  /// Tables of the file; false: it is no module of this machine's kind.
  bool open() {
    const auto header = at<Elf64_Ehdr>(0);
    constexpr unsigned char kOurs = std::endian::native == std::endian::little ? 1 : 2;
    if (!header || std::memcmp(header->e_ident, ELFMAG, SELFMAG) != 0 ||
        header->e_ident[EI_CLASS] != ELFCLASS64 || header->e_ident[EI_DATA] != kOurs ||
        header->e_type != ET_DYN)
      return false;
    return rows(header->e_phoff, header->e_phnum, header->e_phentsize, segments_) &&
           rows(header->e_shoff, header->e_shnum, header->e_shentsize, sections_);
  }

  /// Where an exported symbol lies once loaded, from the module's start.
  [[nodiscard]] std::optional<std::uint64_t> address_of(std::string_view wanted) const {
    for (const Elf64_Shdr& section : sections_) {
      if (section.sh_type != SHT_DYNSYM || section.sh_link >= sections_.size()) continue;
      const std::uint64_t names = sections_[section.sh_link].sh_offset;
      for (std::uint64_t i = 0; i < section.sh_size / sizeof(Elf64_Sym); ++i) {
        const auto symbol = at<Elf64_Sym>(section.sh_offset + i * sizeof(Elf64_Sym));
        if (!symbol) break;
        if (symbol->st_shndx != SHN_UNDEF && text(names + symbol->st_name) == wanted)
          return symbol->st_value;
      }
    }
    return std::nullopt;
  }

  [[nodiscard]] std::optional<std::uint32_t> number_at(std::uint64_t address) const {
    const auto offset = offset_of(address);
    return offset ? at<std::uint32_t>(*offset) : std::nullopt;
  }

  /// The text that the pointer at `address` will point to; empty: to none that can be found.
  [[nodiscard]] std::string text_behind(std::uint64_t address) const {
    const auto pointer = offset_of(address);
    if (!pointer) return {};
    // The loader fills pointers in; what it will write stands in the relocation, or in place.
    std::uint64_t target = at<std::uint64_t>(*pointer).value_or(0);
    for (const Elf64_Shdr& section : sections_) {
      if (section.sh_type != SHT_RELA) continue;
      for (std::uint64_t i = 0; i < section.sh_size / sizeof(Elf64_Rela); ++i) {
        const auto relocation = at<Elf64_Rela>(section.sh_offset + i * sizeof(Elf64_Rela));
        if (!relocation) break;
        if (relocation->r_offset == address)
          target = static_cast<std::uint64_t>(relocation->r_addend);
      }
    }
    const auto offset = offset_of(target);
    return offset ? text(*offset) : std::string();
  }

 private:
  template <class T>
  [[nodiscard]] std::optional<T> at(std::uint64_t offset) const {
    if (offset > bytes_.size() || bytes_.size() - offset < sizeof(T)) return std::nullopt;
    T value;
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }

  template <class Row>
  bool rows(std::uint64_t offset, std::size_t count, std::size_t size, std::vector<Row>& into) {
    if (count > 0 && size != sizeof(Row)) return false;
    for (std::size_t i = 0; i < count; ++i) {
      const auto row = at<Row>(offset + i * sizeof(Row));
      if (!row) return false;
      into.push_back(*row);
    }
    return true;
  }

  [[nodiscard]] std::string text(std::uint64_t offset) const {
    if (offset >= bytes_.size()) return {};
    const std::string_view rest = std::string_view(bytes_).substr(offset, kLongestText);
    return std::string(rest.substr(0, rest.find('\0')));
  }

  [[nodiscard]] std::optional<std::uint64_t> offset_of(std::uint64_t address) const {
    for (const Elf64_Phdr& segment : segments_)
      if (segment.p_type == PT_LOAD && address >= segment.p_vaddr &&
          address - segment.p_vaddr < segment.p_filesz)
        return segment.p_offset + (address - segment.p_vaddr);
    return std::nullopt;
  }

  std::string bytes_;
  std::vector<Elf64_Phdr> segments_;
  std::vector<Elf64_Shdr> sections_;
};

}  // namespace

Result<EntryFacts> read_entry(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  Module module(std::string(std::istreambuf_iterator<char>(stream), {}));
  if (!stream.good() && !stream.eof())
    return Error{Code::unavailable, file.string() + " cannot be read"};
  if (!module.open())
    return Error{Code::unavailable, file.string() + " is no module of this machine"};
  const auto address = module.address_of(kSymbol);
  const auto abi =
      address ? module.number_at(*address + offsetof(AlhazenDriverEntry, abi)) : std::nullopt;
  if (!abi)
    return Error{Code::unsupported,
                 file.string() + " is not a driver: it has no symbol " + std::string(kSymbol)};
  EntryFacts facts;
  facts.abi = *abi;
  if (facts.abi != kDriverAbi) return facts;
  facts.build = module.text_behind(*address + offsetof(AlhazenDriverEntry, build));
  facts.name = module.text_behind(*address + offsetof(AlhazenDriverEntry, name));
  return facts;
}

}  // namespace alhazen

#include "daemon/devices/loader.h"

#include <dlfcn.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "daemon/devices/entry_file.h"

namespace alhazen {
namespace {

/// Names become file names: nothing but these may stand in them.
bool is_driver_name(std::string_view name) {
  return !name.empty() && name.size() <= 32 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

std::string last_dl_error() {
  const char* text = dlerror();  // glibc keeps it per thread
  return text != nullptr ? text : "no reason given";
}

Status judge(const EntryFacts& facts, std::string_view expected_name) {
  const std::string who = "driver '" + std::string(expected_name) + "' ";
  if (facts.abi != kDriverAbi)
    return Error{Code::unsupported, who + "speaks driver ABI " + std::to_string(facts.abi) +
                                        ", this daemon speaks " + std::to_string(kDriverAbi) +
                                        "; build both from one tree"};
  if (facts.build != ALHAZEN_DRIVER_BUILD)
    return Error{Code::unsupported, who + "was built as '" + facts.build +
                                        "', this daemon as '" ALHAZEN_DRIVER_BUILD
                                        "'; build both the same way"};
  if (facts.name != expected_name)
    return Error{Code::unsupported,
                 who + "calls itself '" + facts.name + "'; file and driver must have one name"};
  return {};
}

/// Nothing behind the number is read before it fits: another ABI may have another layout.
EntryFacts facts_of(const AlhazenDriverEntry& entry) {
  if (entry.abi != kDriverAbi) return {entry.abi, {}, {}};
  return {entry.abi, entry.build != nullptr ? entry.build : "",
          entry.name != nullptr ? entry.name : ""};
}

Status complete(const AlhazenDriverEntry& entry, std::string_view name) {
  if (entry.open == nullptr || entry.summary == nullptr)
    return Error{Code::unsupported,
                 "driver '" + std::string(name) + "' has an entry that is not complete"};
  return {};
}

}  // namespace

Result<const AlhazenDriverEntry*> Loader::load(const std::string& name) {
  if (const auto known = entries_.find(name); known != entries_.end()) return known->second;
  if (!is_driver_name(name))
    return Error{Code::invalid,
                 "driver name '" + name + "' must be 1 to 32 characters of a-z 0-9 _ -"};
  const std::filesystem::path file = folder_ / ("alhazen-" + name + ".so");
  std::error_code trouble;
  if (!std::filesystem::exists(file, trouble))
    return Error{Code::unavailable, "driver '" + name + "': no file " + file.string()};
  const EntryFacts facts =
      ALHAZEN_TRY(read_entry(file).in("driver '" + name + "' cannot be loaded"));
  ALHAZEN_TRY(judge(facts, name));
  void* module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (module == nullptr)
    return Error{Code::unavailable, "driver '" + name + "' cannot be loaded: " + last_dl_error()};
  const auto* entry = static_cast<const AlhazenDriverEntry*>(dlsym(module, "alhazen_driver_entry"));
  if (entry == nullptr)
    return Error{Code::unsupported,
                 file.string() + " is not a driver: it has no symbol alhazen_driver_entry"};
  ALHAZEN_TRY(complete(*entry, name));
  entries_.emplace(name, entry);
  return entry;
}

Status Loader::adopt(const AlhazenDriverEntry& entry) {
  const EntryFacts facts = facts_of(entry);
  const std::string name = facts.name.empty() ? "handed in" : facts.name;
  ALHAZEN_TRY(judge(facts, name));
  ALHAZEN_TRY(complete(entry, name));
  if (!entries_.emplace(name, &entry).second)
    return Error{Code::conflict, "driver '" + name + "' is there already"};
  return {};
}

}  // namespace alhazen

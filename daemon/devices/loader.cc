#include "daemon/devices/loader.h"

#include <dlfcn.h>

#include <algorithm>
#include <system_error>
#include <utility>

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

}  // namespace

Status judge(const AlhazenDriverEntry& entry, std::string_view expected_name) {
  const std::string who = "driver '" + std::string(expected_name) + "' ";
  if (entry.abi != kDriverAbi)
    return Error{Code::unsupported, who + "speaks driver ABI " + std::to_string(entry.abi) +
                                        ", this daemon speaks " + std::to_string(kDriverAbi) +
                                        "; build both from one tree"};
  // Nothing behind the number is read before it fits: another ABI may have another layout.
  if (entry.build == nullptr || std::string_view(entry.build) != ALHAZEN_DRIVER_BUILD)
    return Error{Code::unsupported,
                 who + "was built as '" + (entry.build != nullptr ? entry.build : "") +
                     "', this daemon as '" ALHAZEN_DRIVER_BUILD "'; build both the same way"};
  if (entry.name == nullptr || entry.name != expected_name)
    return Error{Code::unsupported, who + "calls itself '" +
                                        (entry.name != nullptr ? entry.name : "") +
                                        "'; file and driver must have one name"};
  if (entry.open == nullptr || entry.summary == nullptr)
    return Error{Code::unsupported, who + "has an entry that is not complete"};
  return {};
}

Result<const AlhazenDriverEntry*> Loader::load(const std::string& name) {
  if (const auto known = entries_.find(name); known != entries_.end()) return known->second;
  if (!is_driver_name(name))
    return Error{Code::invalid,
                 "driver name '" + name + "' must be 1 to 32 characters of a-z 0-9 _ -"};
  const std::filesystem::path file = folder_ / ("alhazen-" + name + ".so");
  std::error_code trouble;
  if (!std::filesystem::exists(file, trouble))
    return Error{Code::unavailable, "driver '" + name + "': no file " + file.string()};
  void* module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (module == nullptr)
    return Error{Code::unavailable, "driver '" + name + "' cannot be loaded: " + last_dl_error()};
  const auto* entry = static_cast<const AlhazenDriverEntry*>(dlsym(module, "alhazen_driver_entry"));
  if (entry == nullptr)
    return Error{Code::unsupported,
                 file.string() + " is not a driver: it has no symbol alhazen_driver_entry"};
  ALHAZEN_TRY(judge(*entry, name));
  entries_.emplace(name, entry);
  return entry;
}

Status Loader::adopt(const AlhazenDriverEntry& entry) {
  const std::string name =
      entry.abi == kDriverAbi && entry.name != nullptr ? entry.name : "handed in";
  ALHAZEN_TRY(judge(entry, name));
  if (!entries_.emplace(name, &entry).second)
    return Error{Code::conflict, "driver '" + name + "' is there already"};
  return {};
}

}  // namespace alhazen

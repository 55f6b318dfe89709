#include "daemon/config.h"

#include <toml++/toml.h>

#include <algorithm>
#include <initializer_list>
#include <iterator>
#include <optional>
#include <set>
#include <system_error>
#include <tuple>
#include <utility>
#include <vector>

#include "alhazen/caught.h"
#include "daemon/log.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

/// A configuration is written by hand.
constexpr std::uint64_t kMaxConfigBytes = std::uint64_t{1} << 20;
/// sockaddr_un.sun_path of unix(7), less its terminating zero.
constexpr std::size_t kMaxSocketPath = 107;
constexpr std::int64_t kMaxExposureUs = 60'000'000;
constexpr double kMinGainDb = -24, kMaxGainDb = 72;

int line_of(const toml::node& node) { return static_cast<int>(node.source().begin.line); }

/// "rig.toml:12: ".
std::string position(const fs::path& file, int line) {
  return file.string() + (line > 0 ? ":" + std::to_string(line) : "") + ": ";
}

Error complaint(const fs::path& file, int line, const std::string& sentence) {
  return {Code::invalid, position(file, line) + sentence};
}

/// A key as people write it: "camera.left".
std::string dotted(std::string table, std::string_view key) {
  table += '.';
  table += key;
  return table;
}

bool is_name(std::string_view name) {
  return !name.empty() && name.size() <= 32 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

Result<toml::table> parse_toml(std::string_view text, const fs::path& file) {
  return caught(Code::invalid, file.string(), [&]() -> Result<toml::table> {
    try {
      return toml::parse(text, file.string());
    } catch (const toml::parse_error& error) {
      return complaint(file, static_cast<int>(error.source().begin.line),
                       std::string(error.description()));
    }
  });
}

/// One value of a table as Settings know it. Fails: invalid (a date, a table, a list of anything
/// but numbers).
Result<Settings::Value> value_of(const toml::node& node, const fs::path& file,
                                 const std::string& key) {
  if (const auto* flag = node.as_boolean()) return Settings::Value(flag->get());
  if (const auto* whole = node.as_integer()) return Settings::Value(whole->get());
  if (const auto* real = node.as_floating_point()) return Settings::Value(real->get());
  if (const auto* text = node.as_string()) return Settings::Value(text->get());
  if (const auto* array = node.as_array()) {
    std::vector<double> numbers;
    for (const toml::node& element : *array) {
      const auto number = element.value<double>();
      if (!element.is_number() || !number)
        return complaint(file, line_of(element),
                         "key '" + key + "' holds something else than numbers");
      numbers.push_back(*number);
    }
    return Settings::Value(std::move(numbers));
  }
  return complaint(
      file, line_of(node),
      "key '" + key + "' must be true or false, a number, text in quotes or an array of numbers");
}

/// Where a table begins: "rig.toml:12".
std::string place_of(const fs::path& file, const toml::table& table) {
  return file.string() + ":" + std::to_string(line_of(table));
}

/// A key that must be there, as text. Fails: invalid, at the line where its table begins.
Status require(const toml::table& table, const fs::path& file, const std::string& name,
               const char* key) {
  if (table.contains(key)) return {};
  return complaint(file, line_of(table),
                   "key '" + dotted(name, key) + "' is missing; it must be text in quotes");
}

/// Entries of a table in the order of the file.
std::vector<std::pair<std::string, const toml::node*>> in_order(const toml::table& table) {
  std::vector<std::pair<std::string, const toml::node*>> entries;
  for (const auto& [key, node] : table) entries.emplace_back(std::string(key.str()), &node);
  std::stable_sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) {
    const auto place = [](const toml::node* node) {
      return std::pair(node->source().begin.line, node->source().begin.column);
    };
    return place(a.second) < place(b.second);
  });
  return entries;
}

/// A table as Settings, without the keys in `except`.
Result<Settings> settings_of(const toml::table& table, const fs::path& file,
                             const std::string& name, const std::set<std::string>& except = {}) {
  Settings settings(file.string(), name, file.parent_path().string());
  for (const auto& [key, node] : in_order(table))
    if (except.count(key) == 0)
      settings.set(key, ALHAZEN_TRY(value_of(*node, file, dotted(name, key))), line_of(*node));
  return settings;
}

/// The tables [kind.NAME] in the order of the file.
Result<std::vector<std::pair<std::string, const toml::table*>>> tables_of(const toml::table& root,
                                                                          const std::string& kind,
                                                                          const fs::path& file) {
  std::vector<std::pair<std::string, const toml::table*>> tables;
  const toml::node* group = root.get(kind);
  if (group == nullptr) return tables;
  if (!group->is_table())
    return complaint(file, line_of(*group),
                     "'" + kind + "' must be tables called [" + kind + ".NAME]");
  for (const auto& [name, node] : in_order(*group->as_table())) {
    if (!node->is_table())
      return complaint(file, line_of(*node),
                       "'" + dotted(kind, name) + "' must be a table [" + kind + ".NAME]");
    if (!is_name(name))
      return complaint(file, line_of(*node),
                       "name '" + name + "' must be 1 to 32 characters of a-z 0-9 _ -");
    tables.emplace_back(name, node->as_table());
  }
  return tables;
}

/// An endpoint of ZeroMQ that stays on this machine; relative ipc paths start from `folder`.
Result<std::string> endpoint_of(const Settings& settings, const std::string& key,
                                const std::string& fallback) {
  const std::string given = ALHAZEN_TRY(settings.text_or(key, fallback));
  const std::string ipc = "ipc://";
  if (given.rfind(ipc, 0) == 0 && given.size() > ipc.size()) {
    fs::path path = given.substr(ipc.size());
    if (path.is_relative()) path = fs::path(settings.folder()) / path;
    if (path.string().size() > kMaxSocketPath)
      return Error{Code::invalid, "key 'daemon." + key + "' is the path " + path.string() + " of " +
                                      std::to_string(path.string().size()) +
                                      " bytes; a socket's may have at most " +
                                      std::to_string(kMaxSocketPath)};
    return ipc + path.string();
  }
  const std::string local = "tcp://127.0.0.1:";
  if (given.rfind(local, 0) == 0) {
    const std::string port = given.substr(local.size());
    const bool digits =
        !port.empty() && port.size() <= 5 &&
        std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (digits && std::stoi(port) >= 1 && std::stoi(port) <= 65535) return given;
  }
  return Error{Code::invalid, "key 'daemon." + key + "' is \"" + given.substr(0, 200) +
                                  "\"; it must be ipc://PATH or tcp://127.0.0.1:PORT, port 1 to "
                                  "65535 (nothing off this machine without keys)"};
}

Result<Config> daemon_of(const toml::table& root, const fs::path& file) {
  const toml::node* node = root.get("daemon");
  if (node == nullptr || !node->is_table())
    return complaint(file, node != nullptr ? line_of(*node) : 0, "table [daemon] is missing");
  const Settings settings = ALHAZEN_TRY(settings_of(*node->as_table(), file, "daemon"));
  const auto path = [&](const char* key) -> Result<std::string> {
    ALHAZEN_TRY(require(*node->as_table(), file, "daemon", key));
    return settings.path(key);
  };
  const auto path_or = [&](const char* key, const char* fallback) {
    return settings.has(key) ? settings.path(key) : Result<std::string>(std::string(fallback));
  };
  const auto at = [&](const char* key) {
    const toml::node* value = node->as_table()->get(key);
    return position(file, value != nullptr ? line_of(*value) : 0);
  };
  Config config;
  config.file = file;
  config.data_directory = ALHAZEN_TRY(path("data"));
  config.rig_file = ALHAZEN_TRY(path("rig"));
  config.plan_folder = ALHAZEN_TRY(path("plans"));
  config.driver_folder = ALHAZEN_TRY(path_or("drivers", ""));
  config.preview_directory = ALHAZEN_TRY(path_or("preview", "/run/alhazen/preview"));
  for (const auto& [key, fallback, endpoint] :
       {std::tuple("control", "ipc:///run/alhazen/control", &config.control_endpoint),
        std::tuple("events", "ipc:///run/alhazen/events", &config.event_endpoint)}) {
    auto given = endpoint_of(settings, key, fallback);
    if (!given) return Error{Code::invalid, at(key) + given.error().what};
    *endpoint = *std::move(given);
  }
  if (config.control_endpoint == config.event_endpoint)
    return Error{Code::invalid,
                 at("events") + "'daemon.events' and 'daemon.control' must be two endpoints"};
  const std::string clock = ALHAZEN_TRY(settings.text_or("clock", "system"));
  if (clock != "system" && clock != "virtual")
    return Error{Code::invalid, at("clock") + "key 'daemon.clock' is \"" + clock +
                                    "\"; it must be \"system\" or \"virtual\""};
  config.clock = clock == "system" ? ClockKind::system : ClockKind::virtual_time;
  const std::string level = ALHAZEN_TRY(settings.text_or("log_level", "info"));
  const auto severity = severity_of(level);
  if (!severity)
    return Error{Code::invalid, at("log_level") + "key 'daemon.log_level' is \"" + level +
                                    "\"; it must be debug, info, warning or error"};
  config.log_level = *severity;
  ALHAZEN_TRY(settings.all_known());
  return config;
}

/// [kind.NAME] tables of devices. Names are unique over all kinds.
Result<std::vector<DeviceSpec>> devices_of(const toml::table& root, const std::string& kind,
                                           const fs::path& file,
                                           const std::vector<DriverSpec>& drivers,
                                           std::set<std::string>& names) {
  std::vector<DeviceSpec> specs;
  for (const auto& [name, table] : ALHAZEN_TRY(tables_of(root, kind, file))) {
    const std::string label = dotted(kind, name);
    if (!names.insert(name).second)
      return complaint(file, line_of(*table), "two devices are called '" + name + "'");
    const Settings own = ALHAZEN_TRY(settings_of(*table, file, label));
    DeviceSpec spec;
    spec.name = name;
    spec.place = place_of(file, *table);
    ALHAZEN_TRY(require(*table, file, label, "driver"));
    spec.driver = ALHAZEN_TRY(own.text("driver"));
    if (std::none_of(drivers.begin(), drivers.end(),
                     [&](const DriverSpec& driver) { return driver.name == spec.driver; }))
      return complaint(file, line_of(*table->get("driver")),
                       "key '" + label + ".driver' is \"" + spec.driver +
                           "\", but there is no table [driver." + spec.driver + "]");
    std::set<std::string> taken{"driver"};
    if (kind == "camera") {
      // The contract sets these for every frame, so no driver asks for them.
      spec.preferred.exposure = Micros(ALHAZEN_TRY(
          own.integer_or("exposure_us", spec.preferred.exposure.count(), 1, kMaxExposureUs)));
      spec.preferred.gain_db = ALHAZEN_TRY(own.number_or("gain_db", 0, kMinGainDb, kMaxGainDb));
      taken.insert({"exposure_us", "gain_db"});
    }
    spec.settings = ALHAZEN_TRY(settings_of(*table, file, label, taken));
    specs.push_back(std::move(spec));
  }
  return specs;
}

Result<Config> config_of(const toml::table& root, const fs::path& file) {
  static constexpr const char* kTables[] = {"daemon", "driver", "camera", "display", "turntable"};
  for (const auto& [key, node] : in_order(root))
    if (std::find(std::begin(kTables), std::end(kTables), key) == std::end(kTables))
      return complaint(file, line_of(*node),
                       "unknown key '" + key +
                           "'; there are the tables daemon, driver, camera, display, turntable");
  Config config = ALHAZEN_TRY(daemon_of(root, file));
  for (const auto& [name, table] : ALHAZEN_TRY(tables_of(root, "driver", file))) {
    DriverSpec spec;
    spec.name = name;
    spec.place = place_of(file, *table);
    ALHAZEN_TRY(require(*table, file, "driver." + name, "use"));
    const Settings own = ALHAZEN_TRY(settings_of(*table, file, "driver." + name));
    spec.use = ALHAZEN_TRY(own.text("use"));
    if (!is_name(spec.use))
      return complaint(file, line_of(*table->get("use")),
                       "key 'driver." + name + ".use' is \"" + spec.use +
                           "\"; it must be 1 to 32 characters of a-z 0-9 _ -");
    spec.settings = ALHAZEN_TRY(settings_of(*table, file, "driver." + name, {"use"}));
    config.devices.drivers.push_back(std::move(spec));
  }
  std::set<std::string> names;
  const auto& drivers = config.devices.drivers;
  config.devices.cameras = ALHAZEN_TRY(devices_of(root, "camera", file, drivers, names));
  config.devices.displays = ALHAZEN_TRY(devices_of(root, "display", file, drivers, names));
  config.devices.turntables = ALHAZEN_TRY(devices_of(root, "turntable", file, drivers, names));
  if (config.devices.turntables.size() > 1)
    return complaint(
        file, line_of(*root.get("turntable")),
        "a rig has one turntable, here are " + std::to_string(config.devices.turntables.size()));
  return config;
}

/// An array of names: the one value that Settings do not know.
Result<std::optional<std::vector<std::string>>> names_of(const toml::table& table,
                                                         const std::string& key,
                                                         const fs::path& file) {
  const toml::node* node = table.get(key);
  if (node == nullptr) return std::optional<std::vector<std::string>>();
  const toml::array* array = node->as_array();
  std::vector<std::string> names;
  if (array != nullptr)
    for (const toml::node& element : *array)
      if (const auto* text = element.as_string(); text && is_name(text->get()))
        names.push_back(text->get());
  if (array == nullptr || names.empty() || names.size() != array->size())
    return complaint(file, line_of(*node),
                     "key '" + key + "' must be an array of names: text of a-z 0-9 _ -");
  return std::optional(std::move(names));
}

template <class Value, class Read>
Status read_into(std::optional<Value>& choice, const Settings& settings, const char* key,
                 Read read) {
  if (settings.has(key)) choice = ALHAZEN_TRY(read());
  return {};
}

/// One word of a list, as an enumerator.
template <class Word>
Result<Word> word_of(const Settings& settings, const char* key, const fs::path& file,
                     const toml::table& table,
                     std::initializer_list<std::pair<const char*, Word>> words) {
  const std::string given = ALHAZEN_TRY(settings.text(key));
  std::string known;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    known += (known.empty() ? "" : ", ") + std::string(word);
  }
  return complaint(
      file, line_of(*table.get(key)),
      "key '" + std::string(key) + "' is \"" + given + "\"; it must be one of: " + known);
}

Result<Preset> preset_of(const toml::table& table, const fs::path& file) {
  Preset preset;
  preset.name = file.stem().string();
  if (!is_name(preset.name))
    return complaint(file, 0, "the file's name is the plan's: 1 to 32 characters of a-z 0-9 _ -");
  PlanChoices& choices = preset.choices;
  choices.displays = ALHAZEN_TRY(names_of(table, "displays", file));
  choices.cameras = ALHAZEN_TRY(names_of(table, "cameras", file));
  Settings settings(file.string(), "", "");
  for (const auto& [key, node] : in_order(table))
    if (key != "displays" && key != "cameras")
      settings.set(key, ALHAZEN_TRY(value_of(*node, file, key)), line_of(*node));

  preset.summary = ALHAZEN_TRY(settings.text("summary"));
  const auto whole = [&](const char* key, std::int64_t min, std::int64_t max) {
    return [&settings, key, min, max]() -> Result<int> {
      return static_cast<int>(ALHAZEN_TRY(settings.integer(key, min, max)));
    };
  };
  ALHAZEN_TRY(read_into(choices.stops, settings, "stops", whole("stops", 1, kMaxStops)));
  ALHAZEN_TRY(read_into(choices.level, settings, "level", whole("level", kMinLevel, kMaxLevel)));
  ALHAZEN_TRY(read_into(choices.exposure, settings, "exposure_us", [&]() -> Result<Micros> {
    return Micros(ALHAZEN_TRY(settings.integer("exposure_us", 1, kMaxExposureUs)));
  }));
  ALHAZEN_TRY(read_into(choices.gain_db, settings, "gain_db",
                        [&] { return settings.number("gain_db", kMinGainDb, kMaxGainDb); }));
  ALHAZEN_TRY(read_into(choices.edge_mm, settings, "edge_mm",
                        [&] { return settings.number("edge_mm", kMinEdgeMm, kMaxEdgeMm); }));
  ALHAZEN_TRY(
      read_into(choices.crop, settings, "crop", [&] { return settings.flag_or("crop", true); }));
  ALHAZEN_TRY(read_into(choices.centre_mm, settings, "centre_mm", [&]() -> Result<Eigen::Vector3d> {
    const auto centre = ALHAZEN_TRY(settings.numbers("centre_mm", 3));
    return Eigen::Vector3d(centre[0], centre[1], centre[2]);
  }));
  ALHAZEN_TRY(read_into(choices.angles_deg, settings, "angles_deg", [&] {
    const toml::array* array = table.get("angles_deg")->as_array();
    return settings.numbers("angles_deg", array != nullptr ? array->size() : 1);
  }));
  ALHAZEN_TRY(read_into(choices.coding, settings, "coding", [&] {
    return word_of<Coding>(settings, "coding", file, table,
                           {{"gray", Coding::gray}, {"gray_phase", Coding::gray_phase}});
  }));
  ALHAZEN_TRY(read_into(choices.keep_frames, settings, "keep_frames", [&] {
    return word_of<KeepFrames>(settings, "keep_frames", file, table,
                               {{"none", KeepFrames::none},
                                {"failed", KeepFrames::failed},
                                {"sample", KeepFrames::sample},
                                {"all", KeepFrames::all}});
  }));
  ALHAZEN_TRY(settings.all_known());
  return preset;
}

}  // namespace

Result<Config> Config::parse(std::string_view text, const fs::path& file) {
  if (text.size() > kMaxConfigBytes)
    return complaint(file, 0, "is larger than " + std::to_string(kMaxConfigBytes) + " bytes");
  const toml::table root = ALHAZEN_TRY(parse_toml(text, file));
  return caught(Code::invalid, file.string(), [&] { return config_of(root, file); });
}

Result<Config> Config::load(const fs::path& file) {
  std::error_code trouble;
  const fs::path absolute = fs::absolute(file, trouble);
  const std::string text = ALHAZEN_TRY(read_file(absolute, kMaxConfigBytes));
  Config config = ALHAZEN_TRY(parse(text, absolute));
  const toml::table root = ALHAZEN_TRY(parse_toml(text, absolute));
  const auto missing = [&](const char* key, const fs::path& path, const char* wanted) {
    return complaint(absolute, line_of(*root["daemon"][key].node()),
                     "key 'daemon." + std::string(key) + "' names " + path.string() + ", which " +
                         (fs::exists(path, trouble) ? "is something else" : "does not exist") +
                         "; it must be " + wanted);
  };
  if (!fs::is_regular_file(config.rig_file, trouble))
    return missing("rig", config.rig_file, "a calibrated rig.json");
  if (!fs::is_directory(config.plan_folder, trouble))
    return missing("plans", config.plan_folder, "a folder of plans, *.toml");
  if (!config.driver_folder.empty() && !fs::is_directory(config.driver_folder, trouble))
    return missing("drivers", config.driver_folder, "a folder of drivers, alhazen-*.so");
  return config;
}

Result<Preset> parse_preset(std::string_view text, const fs::path& file) {
  const toml::table table = ALHAZEN_TRY(parse_toml(text, file));
  return caught(Code::invalid, file.string(), [&] { return preset_of(table, file); });
}

Result<std::vector<Preset>> load_presets(const fs::path& folder) {
  std::error_code trouble;
  std::vector<fs::path> files;
  for (fs::directory_iterator i(folder, trouble), end; !trouble && i != end; i.increment(trouble))
    if (i->path().extension() == ".toml") files.push_back(i->path());
  if (trouble)
    return Error{Code::unavailable,
                 "cannot list plans in " + folder.string() + ": " + trouble.message()};
  std::sort(files.begin(), files.end());
  std::vector<Preset> presets;
  presets.reserve(files.size());
  for (const fs::path& file : files)
    presets.push_back(
        ALHAZEN_TRY(parse_preset(ALHAZEN_TRY(read_file(file, kMaxConfigBytes)), file)));
  return presets;
}

Status check_clock(const Config& config, Loader& loader) {
  if (config.clock != ClockKind::virtual_time) return {};
  for (const DriverSpec& driver : config.devices.drivers) {
    const auto entry = loader.load(driver.use);
    if (!entry) return driver.blame(entry.error());
    if (!(*entry)->virtual_time)
      return Error{Code::invalid,
                   "clock = \"virtual\" needs drivers that keep to the clock they "
                   "are lent, but driver " +
                       driver.name + " (" + driver.use +
                       ") moves real devices; set clock = \"system\""};
  }
  return {};
}

}  // namespace alhazen

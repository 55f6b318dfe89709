#include "daemon/jobs/store.h"

#include <sqlite3.h>

#include <map>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

namespace alhazen {
namespace {

/// Rises with any change of the tables; an index of another version is rebuilt, never migrated.
constexpr int kVersion = 1;

constexpr const char* kTables = R"(
CREATE TABLE job (id TEXT PRIMARY KEY, place INTEGER NOT NULL, plan TEXT NOT NULL,
                  record TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE scan (id TEXT PRIMARY KEY, object TEXT NOT NULL, note TEXT NOT NULL,
                   operator TEXT NOT NULL, created TEXT NOT NULL, job TEXT NOT NULL,
                   stacks INTEGER NOT NULL, level INTEGER NOT NULL, edge_mm REAL NOT NULL)
                   WITHOUT ROWID;
CREATE TABLE answer (number INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, at INTEGER NOT NULL,
                     request TEXT NOT NULL, reply TEXT NOT NULL);
CREATE INDEX answer_at ON answer (at);
)";

Code code_of(int sqlite) noexcept {
  switch (sqlite & 0xff) {  // the low byte is the primary code
    case SQLITE_FULL:
    case SQLITE_NOMEM:
      return Code::exhausted;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return Code::conflict;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return Code::corrupt;
    default:
      return Code::unavailable;
  }
}

std::int64_t seconds(std::chrono::system_clock::time_point at) {
  return std::chrono::duration_cast<std::chrono::seconds>(at.time_since_epoch()).count();
}

struct Close {
  void operator()(sqlite3* database) const noexcept { sqlite3_close_v2(database); }
};
struct Finalize {
  void operator()(sqlite3_stmt* statement) const noexcept { sqlite3_finalize(statement); }
};
using Database = std::unique_ptr<sqlite3, Close>;
using Statement = std::unique_ptr<sqlite3_stmt, Finalize>;

Error failure(sqlite3* database, int code) {
  return {code_of(code), std::string("index: ") + (database != nullptr ? sqlite3_errmsg(database)
                                                                       : sqlite3_errstr(code))};
}

Status execute(sqlite3* database, const char* sql) {
  const int code = sqlite3_exec(database, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) return failure(database, code);
  return {};
}

/// One prepared statement with its values bound; gives rows, then ends.
class Query {
 public:
  Query(sqlite3* database, sqlite3_stmt* statement) : database_(database), statement_(statement) {}
  ~Query() {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
  }
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  Query& bind(std::string_view text) {
    sqlite3_bind_text64(statement_, ++bound_, text.data(), text.size(), SQLITE_TRANSIENT,
                        SQLITE_UTF8);
    return *this;
  }
  Query& bind(std::int64_t whole) {
    sqlite3_bind_int64(statement_, ++bound_, whole);
    return *this;
  }
  Query& bind(double number) {
    sqlite3_bind_double(statement_, ++bound_, number);
    return *this;
  }
  /// True: there is a row; false: no more.
  Result<bool> next() {
    const int code = sqlite3_step(statement_);
    if (code == SQLITE_ROW) return true;
    if (code == SQLITE_DONE) return false;
    return failure(database_, code);
  }
  Status run() {
    const bool row = ALHAZEN_TRY(next());
    static_cast<void>(row);
    return {};
  }
  [[nodiscard]] std::string text(int column) const {
    const auto* bytes = sqlite3_column_blob(statement_, column);
    const auto count = static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
    return bytes == nullptr ? std::string() : std::string(static_cast<const char*>(bytes), count);
  }
  [[nodiscard]] std::int64_t whole(int column) const {
    return sqlite3_column_int64(statement_, column);
  }
  [[nodiscard]] double number(int column) const {
    return sqlite3_column_double(statement_, column);
  }

 private:
  sqlite3* database_;
  sqlite3_stmt* statement_;
  int bound_ = 0;
};

}  // namespace

struct Store::State {
  Database database;
  bool is_new = false, was_damaged = false;
  mutable std::map<std::string, Statement, std::less<>> statements;

  /// REQUIRES: the SQL is right; a mistake in it is ours.
  Query query(const char* sql) const {
    auto& statement = statements[sql];
    if (!statement) {
      sqlite3_stmt* made = nullptr;
      const int code =
          sqlite3_prepare_v3(database.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &made, nullptr);
      // A damaged schema can fail here, too: the null statement then answers SQLITE_MISUSE.
      if (code == SQLITE_OK) statement.reset(made);
    }
    return {database.get(), statement.get()};
  }
};

namespace {

/// Opens `file` and makes sure that it is a whole index of this version.
Result<Database> open_index(const std::filesystem::path& file, bool& is_new) {
  sqlite3* opened = nullptr;
  const int code =
      sqlite3_open_v2(file.c_str(), &opened,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  Database database(opened);
  if (code != SQLITE_OK) return failure(opened, code);
  // Another process that reads the index (a person with sqlite3) holds it for milliseconds.
  sqlite3_busy_timeout(opened, 2000);
  ALHAZEN_TRY(execute(opened, "PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL;"));
  int version = -1;
  {
    sqlite3_stmt* made = nullptr;
    const int prepared = sqlite3_prepare_v2(opened, "PRAGMA user_version", -1, &made, nullptr);
    const Statement statement(made);
    if (prepared != SQLITE_OK) return failure(opened, prepared);
    Query query(opened, made);
    if (ALHAZEN_TRY(query.next())) version = static_cast<int>(query.whole(0));
  }
  if (version == 0) {
    is_new = true;
    ALHAZEN_TRY(execute(opened, "BEGIN"));
    ALHAZEN_TRY(execute(opened, kTables));
    ALHAZEN_TRY(execute(opened, ("PRAGMA user_version = " + std::to_string(kVersion)).c_str()));
    ALHAZEN_TRY(execute(opened, "COMMIT"));
  } else if (version != kVersion) {
    return Error{Code::corrupt,
                 "index: version " + std::to_string(version) + ", not " + std::to_string(kVersion)};
  } else {
    sqlite3_stmt* made = nullptr;
    const int prepared = sqlite3_prepare_v2(opened, "PRAGMA quick_check(1)", -1, &made, nullptr);
    const Statement statement(made);
    if (prepared != SQLITE_OK) return failure(opened, prepared);
    Query query(opened, made);
    if (ALHAZEN_TRY(query.next()) && query.text(0) != "ok")
      return Error{Code::corrupt, "index: " + query.text(0)};
  }
  return database;
}

}  // namespace

Store::Store(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

Result<Store> Store::open(const std::filesystem::path& file) {
  auto state = std::make_unique<State>();
  auto database = open_index(file, state->is_new);
  if (!database && database.error().code == Code::corrupt) {
    state->was_damaged = true;
    std::error_code ignored;
    for (const char* suffix : {"", "-wal", "-shm"}) {
      const std::filesystem::path part(file.string() + suffix);
      std::filesystem::rename(part, file.string() + ".damaged" + suffix, ignored);
    }
    database = open_index(file, state->is_new);
  }
  if (!database) return std::move(database.error()).in(file.string());
  state->database = *std::move(database);
  return Store(std::move(state));
}

bool Store::is_new() const noexcept { return state_->is_new; }
bool Store::was_damaged() const noexcept { return state_->was_damaged; }

Status Store::put(const Job& job, std::int64_t order, std::string_view plan) {
  const std::string record =
      to_json(job).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return state_->query("INSERT OR REPLACE INTO job (id, place, plan, record) VALUES (?, ?, ?, ?)")
      .bind(job.id)
      .bind(order)
      .bind(plan)
      .bind(std::string_view(record))
      .run();
}

Result<std::vector<Store::StoredJob>> Store::jobs(std::uint64_t& damaged) const {
  damaged = 0;
  std::vector<StoredJob> found;
  Query query = state_->query("SELECT record, place, plan FROM job ORDER BY place, id");
  while (ALHAZEN_TRY(query.next())) {
    Result<Job> job = parse_job(query.text(0));
    if (job)
      found.push_back({*std::move(job), query.whole(1), query.text(2)});
    else
      ++damaged;
  }
  return found;
}

Status Store::drop_job(std::string_view id) {
  return state_->query("DELETE FROM job WHERE id = ?").bind(id).run();
}

Status Store::put(const ScanEntry& scan) {
  return state_
      ->query(
          "INSERT OR REPLACE INTO scan (id, object, note, operator, created, job, stacks, "
          "level, edge_mm) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .bind(std::string_view(scan.id))
      .bind(std::string_view(scan.object_id))
      .bind(std::string_view(scan.note))
      .bind(std::string_view(scan.operator_name))
      .bind(std::string_view(scan.created_at))
      .bind(std::string_view(scan.job))
      .bind(static_cast<std::int64_t>(scan.stacks))
      .bind(std::int64_t{scan.level})
      .bind(scan.edge_mm)
      .run();
}

Result<std::vector<ScanEntry>> Store::scans() const {
  std::vector<ScanEntry> found;
  Query query = state_->query(
      "SELECT id, object, note, operator, created, job, stacks, level, edge_mm FROM scan "
      "ORDER BY created, id");
  while (ALHAZEN_TRY(query.next()))
    found.push_back({query.text(0), query.text(1), query.text(2), query.text(3), query.text(4),
                     query.text(5), static_cast<std::uint64_t>(query.whole(6)),
                     static_cast<int>(query.whole(7)), query.number(8)});
  return found;
}

Status Store::drop_scan(std::string_view id) {
  return state_->query("DELETE FROM scan WHERE id = ?").bind(id).run();
}

Result<std::optional<Store::StoredAnswer>> Store::answer(
    std::string_view key, std::chrono::system_clock::time_point now) const {
  Query query = state_->query("SELECT request, reply FROM answer WHERE key = ? AND at > ?");
  query.bind(key).bind(seconds(now - kAnswerLifetime));
  if (!ALHAZEN_TRY(query.next())) return std::optional<StoredAnswer>();
  return std::optional<StoredAnswer>({query.text(0), query.text(1)});
}

Status Store::put_answer(std::string_view key, const StoredAnswer& answer,
                         std::chrono::system_clock::time_point now) {
  ALHAZEN_TRY(
      state_->query("DELETE FROM answer WHERE at <= ?").bind(seconds(now - kAnswerLifetime)).run());
  ALHAZEN_TRY(
      state_->query("INSERT OR REPLACE INTO answer (key, at, request, reply) VALUES (?, ?, ?, ?)")
          .bind(key)
          .bind(seconds(now))
          .bind(std::string_view(answer.request))
          .bind(std::string_view(answer.reply))
          .run());
  // Numbers rise with every answer, so the oldest are found without looking at the others.
  return state_->query("DELETE FROM answer WHERE number <= (SELECT max(number) FROM answer) - ?")
      .bind(std::int64_t{kMostAnswers})
      .run();
}

Status Store::begin() { return execute(state_->database.get(), "BEGIN IMMEDIATE"); }
Status Store::commit() { return execute(state_->database.get(), "COMMIT"); }
void Store::rollback() noexcept {
  sqlite3_exec(state_->database.get(), "ROLLBACK", nullptr, nullptr, nullptr);
}

}  // namespace alhazen

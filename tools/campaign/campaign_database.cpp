#include "tools/campaign/campaign_database.h"

#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/file.h>

#include "diagnosis/model/digest.h"
#include "diagnosis/model/input_error.h"
#include "tools/bench/run_history.h"
#include "tools/version.h"

namespace faultline {
namespace {

/// Of the tables' layout.
constexpr std::int64_t kSchema = 1;
/// How long somebody who reads may keep us from writing.
constexpr int kBusyTimeout_ms = 10'000;

using Json = nlohmann::ordered_json;

/// A prepared statement. Columns and parameters are numbered from 0 and 1, as SQLite does.
class Statement {
 public:
  Statement(sqlite3* database, const std::string& sql) : database_(database) {
    if (sqlite3_prepare_v2(database, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) fail();
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  void bind(int index, const Cell& cell) {
    int result = SQLITE_OK;
    if (const auto* integer = std::get_if<std::int64_t>(&cell)) {
      result = sqlite3_bind_int64(statement_, index, *integer);
    } else if (const auto* number = std::get_if<double>(&cell)) {
      result = sqlite3_bind_double(statement_, index, *number);
    } else if (const auto* text = std::get_if<std::string>(&cell)) {
      result = sqlite3_bind_text(statement_, index, text->data(), static_cast<int>(text->size()),
                                 SQLITE_TRANSIENT);
    } else {
      result = sqlite3_bind_null(statement_, index);
    }
    if (result != SQLITE_OK) fail();
  }
  /// @return false: no further row.
  bool step() {
    const int result = sqlite3_step(statement_);
    if (result == SQLITE_ROW) return true;
    if (result != SQLITE_DONE) fail();
    return false;
  }
  void reset() { sqlite3_reset(statement_); }

  [[nodiscard]] std::int64_t integer(int column) {
    return sqlite3_column_int64(statement_, column);
  }
  [[nodiscard]] double number(int column) { return sqlite3_column_double(statement_, column); }
  [[nodiscard]] std::string text(int column) {
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
    return bytes == nullptr ? std::string() : std::string(bytes, size);
  }
  [[nodiscard]] Cell cell(int column) {
    switch (sqlite3_column_type(statement_, column)) {
      case SQLITE_INTEGER:
        return integer(column);
      case SQLITE_FLOAT:
        return number(column);
      case SQLITE_NULL:
        return {};
      default:
        return text(column);
    }
  }

 private:
  [[noreturn]] void fail() const {
    const char* const file = sqlite3_db_filename(database_, "main");
    throw DatabaseError(
        fmt::format("{}: {}", file == nullptr ? "" : file, sqlite3_errmsg(database_)));
  }

  sqlite3* database_;
  sqlite3_stmt* statement_ = nullptr;
};

void execute(sqlite3* database, const std::string& sql) {
  Statement statement(database, sql);
  while (statement.step()) {
  }
}

/// Commits at its end, takes everything back if it does not get there.
class Transaction {
 public:
  explicit Transaction(sqlite3* database) : database_(database) {
    execute(database, "BEGIN IMMEDIATE");
  }
  ~Transaction() {
    if (!is_committed_) sqlite3_exec(database_, "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() {
    execute(database_, "COMMIT");
    is_committed_ = true;
  }

 private:
  sqlite3* database_;
  bool is_committed_ = false;
};

std::string run_table() {
  std::string columns;
  for (const RunColumn& column : kRunColumns) {
    columns += fmt::format("{}{} {}", columns.empty() ? "" : ", ", column.name, column.type);
  }
  return fmt::format("CREATE TABLE run ({})", columns);
}

std::string column_names() {
  std::string names;
  for (const RunColumn& column : kRunColumns) {
    names += fmt::format("{}{}", names.empty() ? "" : ", ", column.name);
  }
  return names;
}

std::string smallest_faults(const Bank& bank) {
  Json smallest = Json::object();
  for (std::size_t fault = 0; fault < bank.fault_names.size(); ++fault) {
    const double size = has_own_signature(bank, fault) ? smallest_isolated(bank, fault) : 0.0;
    if (size > 0.0) smallest[bank.fault_names[fault]] = size;
  }
  return smallest.dump();
}

std::string names_json(const std::vector<std::string>& names) { return Json(names).dump(); }

std::vector<std::pair<const char*, Cell>> campaign_columns(const CampaignInputs& inputs) {
  const Sweep& sweep = inputs.sweep();
  const Bank& bank = inputs.base().bank;
  std::vector<std::string> residuals;
  for (const ResidualFilter& filter : bank.filters) residuals.push_back(filter.name);
  std::string bank_text;
  for (const RunPart& part : inputs.base().parts) {
    if (part.part == "bank") bank_text = part.text;
  }
  return {{"schema", kSchema},
          {"name", sweep.name},
          {"digest", inputs.digest()},
          {"version", std::string(kVersion)},
          {"sweep", sweep.text},
          {"seed", sweep.seed},
          {"run_count", static_cast<std::int64_t>(sweep.run_count)},
          {"sampling", std::string(sampling_name(sweep.sampling))},
          {"sample_time_s", bank.sample_time_s},
          {"duration_s", inputs.base().scenario.duration_s},
          {"plant", inputs.base().plant.name},
          {"bank", bank.name},
          {"method", bank.method},
          {"bank_digest", text_digest(bank_text)},
          {"dwell", static_cast<std::int64_t>(bank.decision.dwell)},
          {"faults", names_json(bank.fault_names)},
          {"residuals", names_json(residuals)},
          {"smallest_faults", smallest_faults(bank)}};
}

/// True of a new file, and of one that was killed before it was more. A file of another kind is
/// left to check_is_campaign.
bool is_empty(sqlite3* database) {
  if (sqlite3_exec(database, "SELECT 1 FROM sqlite_master", nullptr, nullptr, nullptr) !=
      SQLITE_OK) {
    return false;
  }
  Statement tables(database, "SELECT count(*) FROM sqlite_master");
  return tables.step() && tables.integer(0) == 0;
}

constexpr char kCampaignTable[] =
    "CREATE TABLE campaign (schema INTEGER, name TEXT, digest TEXT, version TEXT, sweep TEXT, "
    "seed INTEGER, run_count INTEGER, sampling TEXT, sample_time_s REAL, duration_s REAL, "
    "plant TEXT, bank TEXT, method TEXT, bank_digest TEXT, dwell INTEGER, faults TEXT, "
    "residuals TEXT, smallest_faults TEXT)";
constexpr char kAxisTable[] =
    "CREATE TABLE axis (number INTEGER PRIMARY KEY, name TEXT, spec TEXT)";

}  // namespace

struct CampaignDatabase::State {
  std::filesystem::path file;
  CampaignIdentity identity;
  sqlite3* database = nullptr;
  int lock = -1;  ///< the file, locked for one writer

  ~State() {
    sqlite3_close(database);
    if (lock >= 0) ::close(lock);
  }
};

CampaignDatabase::~CampaignDatabase() = default;
CampaignDatabase::CampaignDatabase(CampaignDatabase&&) noexcept = default;
CampaignDatabase& CampaignDatabase::operator=(CampaignDatabase&&) noexcept = default;

void CampaignDatabase::open(const std::filesystem::path& file, bool is_written) {
  state_ = std::make_unique<State>();
  state_->file = file;
  // A name like ":memory:" means something else to SQLite, and so does a URI.
  const std::string name = std::filesystem::absolute(file).string();
  if (is_written) {
    state_->lock = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (state_->lock < 0) {
      throw DatabaseError(fmt::format("{}: {}", file.string(), std::strerror(errno)));
    }
    if (::flock(state_->lock, LOCK_EX | LOCK_NB) != 0) {
      throw DatabaseError(
          fmt::format("{}: another campaign is writing it, expected one at a time", file.string()));
    }
  }
  const int flags = is_written ? SQLITE_OPEN_READWRITE : SQLITE_OPEN_READONLY;
  if (sqlite3_open_v2(name.c_str(), &state_->database, flags, nullptr) != SQLITE_OK) {
    throw DatabaseError(fmt::format("{}: {}", file.string(), sqlite3_errmsg(state_->database)));
  }
  sqlite3_busy_timeout(state_->database, kBusyTimeout_ms);
}

void CampaignDatabase::check_is_campaign() const {
  const auto refuse = [this](const std::string& found) {
    return InputError(state_->file.string(), {},
                      fmt::format("found {}, expected the database of a campaign", found));
  };
  sqlite3* const database = state_->database;
  const int result =
      sqlite3_exec(database, "SELECT name FROM sqlite_master LIMIT 1", nullptr, nullptr, nullptr);
  if (result == SQLITE_NOTADB) throw refuse("no SQLite database");
  if (result != SQLITE_OK) {
    throw DatabaseError(fmt::format("{}: {}", state_->file.string(), sqlite3_errmsg(database)));
  }
  Statement tables(database,
                   "SELECT count(*) FROM sqlite_master WHERE name IN ('campaign', 'axis', 'run')");
  static_cast<void>(tables.step());
  if (tables.integer(0) != 3) throw refuse("other tables");
  Statement schema(database,
                   "SELECT schema, name, digest, run_count, plant, bank, method, version, "
                   "sampling, sample_time_s, duration_s, dwell, faults, residuals, "
                   "smallest_faults FROM campaign");
  if (!schema.step()) throw refuse("no campaign in it");
  if (schema.integer(0) != kSchema) {
    throw refuse(fmt::format("schema {} (this version knows {})", schema.integer(0), kSchema));
  }
  CampaignIdentity& identity = state_->identity;
  identity = {.name = schema.text(1),
              .digest = schema.text(2),
              .run_count = static_cast<std::uint64_t>(schema.integer(3)),
              .plant = schema.text(4),
              .bank = schema.text(5),
              .method = schema.text(6),
              .version = schema.text(7),
              .sampling = schema.text(8),
              .sample_time_s = schema.number(9),
              .duration_s = schema.number(10),
              .dwell = schema.integer(11)};
  try {
    identity.faults = Json::parse(schema.text(12)).get<std::vector<std::string>>();
    identity.residuals = Json::parse(schema.text(13)).get<std::vector<std::string>>();
    const Json sizes = Json::parse(schema.text(14));
    for (const auto& [fault, size] : sizes.items()) {
      identity.smallest_faults.emplace(fault, size.get<double>());
    }
  } catch (const Json::exception&) {
    throw refuse("faults, residuals or smallest_faults that are no JSON");
  }
}

CampaignDatabase::CampaignDatabase(const std::filesystem::path& file,
                                   const CampaignInputs& inputs) {
  open(file, true);
  sqlite3* const database = state_->database;
  if (is_empty(database)) {
    const auto columns = campaign_columns(inputs);
    Transaction transaction(database);
    execute(database, kCampaignTable);
    execute(database, kAxisTable);
    execute(database, run_table());
    std::string names, marks;
    for (const auto& [name, value] : columns) {
      names += fmt::format("{}{}", names.empty() ? "" : ", ", name);
      marks += marks.empty() ? "?" : ", ?";
    }
    Statement insert(database, fmt::format("INSERT INTO campaign ({}) VALUES ({})", names, marks));
    for (std::size_t i = 0; i < columns.size(); ++i) {
      insert.bind(static_cast<int>(i) + 1, columns[i].second);
    }
    insert.step();
    for (std::size_t a = 0; a < inputs.sweep().axes.size(); ++a) {
      Statement axis(database, "INSERT INTO axis VALUES (?, ?, ?)");
      axis.bind(1, static_cast<std::int64_t>(a));
      axis.bind(2, inputs.sweep().axes[a].name);
      axis.bind(3, Sweep::axis_json(inputs.sweep().axes[a]));
      axis.step();
    }
    transaction.commit();
  }
  check_is_campaign();
  if (state_->identity.digest == inputs.digest()) return;
  throw InputError(
      file.string(), {},
      fmt::format("found campaign \"{}\" with digest {}, expected {}, that of {} as it is now (the "
                  "sweep, its scenario, plant, bank or DBC is another): name another database, or "
                  "delete this one",
                  state_->identity.name, state_->identity.digest, inputs.digest(),
                  inputs.sweep().file.string()));
}

CampaignDatabase::CampaignDatabase(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) {
    throw InputError(file.string(), {}, "found no file, expected the database of a campaign");
  }
  open(file, false);
  check_is_campaign();
}

CampaignDatabase::CampaignDatabase(const std::filesystem::path& file,
                                   const CampaignDatabase& other) {
  if (std::filesystem::exists(file)) {
    throw InputError(file.string(), {}, "found a file, expected none: nothing is overwritten");
  }
  open(file, true);
  sqlite3* const database = state_->database;
  {
    Statement attach(database, "ATTACH ? AS other");
    attach.bind(1, std::filesystem::absolute(other.state_->file).string());
    attach.step();
  }
  {
    Transaction transaction(database);
    execute(database, kCampaignTable);
    execute(database, kAxisTable);
    execute(database, run_table());
    execute(database, "INSERT INTO main.campaign SELECT * FROM other.campaign");
    execute(database, "INSERT INTO main.axis SELECT * FROM other.axis");
    transaction.commit();
  }
  execute(database, "DETACH other");
  check_is_campaign();
}

const CampaignIdentity& CampaignDatabase::identity() const noexcept { return state_->identity; }

std::vector<bool> CampaignDatabase::done() const {
  std::vector<bool> done(state_->identity.run_count);
  Statement runs(state_->database, "SELECT run FROM run");
  while (runs.step()) {
    const auto run = static_cast<std::uint64_t>(runs.integer(0));
    if (run < done.size()) done[run] = true;
  }
  return done;
}

void CampaignDatabase::insert(const std::vector<CampaignRow>& rows) {
  if (rows.empty()) return;
  sqlite3* const database = state_->database;
  Transaction transaction(database);
  std::string marks = "?";
  for (std::size_t i = 1; i < kRunColumns.size(); ++i) marks += ", ?";
  Statement insert(database, fmt::format("INSERT INTO run ({}) VALUES ({}) ON CONFLICT DO NOTHING",
                                         column_names(), marks));
  Statement find(database, fmt::format("SELECT {} FROM run WHERE run = ?", column_names()));
  for (const CampaignRow& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) insert.bind(static_cast<int>(i) + 1, row[i]);
    insert.step();
    insert.reset();
    if (sqlite3_changes(database) == 1) continue;
    find.bind(1, row.front());
    static_cast<void>(find.step());
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (find.cell(static_cast<int>(i)) == row[i]) continue;
      throw InputError(
          state_->file.string(), {},
          fmt::format("run {}: found another {} than in the row that is there, expected the same "
                      "run to come to the same: was it made by another version?",
                      std::get<std::int64_t>(row.front()), kRunColumns[i].name));
    }
    find.reset();
  }
  transaction.commit();
}

std::vector<CampaignRow> CampaignDatabase::rows(std::uint64_t from, std::uint64_t count) const {
  Statement select(
      state_->database,
      fmt::format("SELECT {} FROM run WHERE run >= ? ORDER BY run LIMIT ?", column_names()));
  select.bind(1, static_cast<std::int64_t>(from));
  select.bind(2, static_cast<std::int64_t>(count));
  std::vector<CampaignRow> rows;
  while (select.step()) {
    CampaignRow& row = rows.emplace_back();
    for (std::size_t i = 0; i < kRunColumns.size(); ++i) {
      row.push_back(select.cell(static_cast<int>(i)));
    }
  }
  return rows;
}

CampaignTally CampaignDatabase::tally() const {
  CampaignTally tally;
  Statement counts(state_->database,
                   "SELECT count(*), count(error), sum(expectations_met = 0), "
                   "sum(truth <> 'none'), sum(truth <> 'none' AND detected_cycles > 0), "
                   "count(isolation_delay_s), sum(false_alarms), sum(faultless_cycles) * "
                   "(SELECT sample_time_s FROM campaign) / 3600.0 FROM run");
  static_cast<void>(counts.step());
  const auto count = [&](int column) { return static_cast<std::uint64_t>(counts.integer(column)); };
  tally = {.runs = count(0),
           .failed = count(1),
           .not_met = count(2),
           .faulty = count(3),
           .detected = count(4),
           .isolated = count(5),
           .false_alarms = count(6),
           .faultless_h = counts.number(7)};
  Statement failed(state_->database,
                   "SELECT run, error FROM run WHERE error IS NOT NULL ORDER BY run LIMIT 1");
  if (failed.step()) {
    tally.first_failed = failed.integer(0);
    tally.first_error = failed.text(1);
  }
  Statement not_met(state_->database,
                    "SELECT run FROM run WHERE expectations_met = 0 ORDER BY run LIMIT 1");
  if (not_met.step()) tally.first_not_met = not_met.integer(0);
  return tally;
}

}  // namespace faultline

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tools/campaign/campaign_inputs.h"
#include "tools/campaign/campaign_row.h"

namespace faultline {

/// A database of runs cannot be read or written: the disk, its permissions, another process that
/// writes it. What was committed before is safe.
class DatabaseError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What a campaign is, as its database says.
struct CampaignIdentity {
  std::string name, digest;
  std::uint64_t run_count = 0;
  std::string plant, bank, method, version, sampling;
  double sample_time_s = 0.0, duration_s = 0.0;
  std::int64_t dwell = 0;
  std::vector<std::string> faults, residuals;
  /// Sizes from which the design promises that a fault is isolated, where it does.
  std::map<std::string, double, std::less<>> smallest_faults;
};

/// Counts over the runs that are there.
struct CampaignTally {
  std::uint64_t runs = 0, failed = 0, not_met = 0;
  std::uint64_t faulty = 0, detected = 0, isolated = 0;  ///< runs with a fault; of these
  std::uint64_t false_alarms = 0;
  double faultless_h = 0.0;
  std::int64_t first_failed = -1, first_not_met = -1;  ///< numbers of runs; -1: none
  std::string first_error;
};

/// The database of a campaign: SQLite, tables `campaign` (one row), `axis`, `run` (a row per run
/// that is done; docs/campaigns.md). Rows are committed together; a process that is killed loses
/// those it had not committed, and no more.
class CampaignDatabase {
 public:
  /// Opens the database of this campaign, or makes it. One process at a time may write it.
  /// @throws DatabaseError; InputError the file is something else, or of another campaign.
  CampaignDatabase(const std::filesystem::path& file, const CampaignInputs& inputs);
  /// Opens one that is there, to read it. @throws the same.
  explicit CampaignDatabase(const std::filesystem::path& file);
  /// Makes one for the campaign of `other`, which must not be there. @throws the same.
  CampaignDatabase(const std::filesystem::path& file, const CampaignDatabase& other);
  ~CampaignDatabase();
  CampaignDatabase(CampaignDatabase&&) noexcept;
  CampaignDatabase& operator=(CampaignDatabase&&) noexcept;

  [[nodiscard]] const CampaignIdentity& identity() const noexcept;
  /// Per run of the campaign: whether its row is there.
  [[nodiscard]] std::vector<bool> done() const;
  /// Adds rows, all or none. A row that is there already must be the same.
  void insert(const std::vector<CampaignRow>& rows);
  /// Rows in the order of their runs, `count` at most, from run `from` on.
  [[nodiscard]] std::vector<CampaignRow> rows(std::uint64_t from, std::uint64_t count) const;
  [[nodiscard]] CampaignTally tally() const;

 private:
  struct State;
  void open(const std::filesystem::path& file, bool is_written);
  void check_is_campaign() const;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

#include "tools/bench/bank_cache.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/digest.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/certified_design.h"
#include "tools/version.h"

namespace faultline {
namespace {

std::optional<Bank> read_cached(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return std::nullopt;
  try {
    return read_bank(file);
  } catch (const std::exception&) {
    return std::nullopt;  // damaged: designed anew and overwritten
  }
}

void write_cached(const Bank& bank, const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::create_directories(file.parent_path(), error);
  try {
    write_bank(bank, file);
  } catch (const std::exception&) {
    // A cache that cannot be written only costs the next run its time.
  }
}

/// Changes with every build of the program: what another build designed is not taken for this
/// one's.
std::string build_stamp() {
  std::error_code error;
  const auto written = std::filesystem::last_write_time("/proc/self/exe", error);
  const std::int64_t ticks = error ? 0 : written.time_since_epoch().count();
  return fmt::format("{} {}", kVersion, ticks);
}

// A screenful; `faultline design` says it all.
constexpr std::size_t kListedFailures = 10;

std::string not_solvable_text(const PlantModel& plant, const BankRequest& request,
                              const DesignResult& result) {
  std::string text =
      fmt::format("{}: bank \"{}\" is not solvable for plant \"{}\":", request.source, request.name,
                  plant.name);
  const std::vector<std::string> sentences = failure_sentences(result);
  for (std::size_t i = 0; i < std::min(sentences.size(), kListedFailures); ++i) {
    text += "\n  " + sentences[i];
  }
  if (sentences.size() > kListedFailures) {
    text += fmt::format("\n  and {} more", sentences.size() - kListedFailures);
  }
  return text + "\n  faultline design --partial writes a bank of the residuals that exist";
}

}  // namespace

std::filesystem::path bank_cache_folder() {
  if (const char* xdg = std::getenv("XDG_CACHE_HOME"); xdg != nullptr && *xdg != '\0') {
    return std::filesystem::path(xdg) / "faultline";
  }
  if (const char* home = std::getenv("HOME"); home != nullptr && *home != '\0') {
    return std::filesystem::path(home) / ".cache" / "faultline";
  }
  return {};
}

Bank cached_design(const PlantModel& plant, const BankRequest& request) {
  const std::string key =
      text_digest(fmt::format("{}\n{}\n{}", plant_digest(plant), build_stamp(), request.text));
  const std::filesystem::path folder = bank_cache_folder();
  const std::filesystem::path file = folder / (key + ".bank.json");
  if (!folder.empty()) {
    if (auto bank = read_cached(file)) return *std::move(bank);
  }
  DesignResult result = designed_and_certified(plant, request);
  if (!result.is_solvable) {
    throw NotSolvable(not_solvable_text(plant, request, result));
  }
  if (!folder.empty()) write_cached(result.bank, file);
  return std::move(result.bank);
}

}  // namespace faultline

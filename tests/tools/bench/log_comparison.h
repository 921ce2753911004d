#pragma once

#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include <lcm/lcm-cpp.hpp>

namespace faultline {

/// One message of a log without its time stamps.
struct LoggedResidual {
  std::int64_t cycle = 0;
  std::vector<double> residual, evaluation;
  std::vector<std::uint8_t> fired;
  friend bool operator==(const LoggedResidual&, const LoggedResidual&) = default;
};

/// All RESIDUAL messages of a log, in order.
[[nodiscard]] std::vector<LoggedResidual> logged_residuals(const std::filesystem::path& file);

/// The messages of a type on a channel of a log, in order.
template <class Message>
[[nodiscard]] std::vector<Message> logged_messages(const std::filesystem::path& file,
                                                   const std::string& channel) {
  lcm::LogFile log(file.string(), "r");
  if (!log.good()) throw std::runtime_error("cannot read " + file.string());
  std::vector<Message> found;
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    if (event->channel != channel) continue;
    if (found.emplace_back().decode(event->data, 0, event->datalen) < 0) {
      throw std::runtime_error("cannot decode a " + channel + " of " + file.string());
    }
  }
  return found;
}

/// Index of the first difference to the bit, or the common size if there is none; both sizes must
/// be equal for equality.
[[nodiscard]] std::size_t first_difference(const std::vector<LoggedResidual>& a,
                                           const std::vector<LoggedResidual>& b);

/// A folder of its own for one test, removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace faultline

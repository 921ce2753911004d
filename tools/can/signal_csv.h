#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "drivers/dbc/dbc_database.h"
#include "tools/can/frame_log.h"

namespace faultline {

// A CSV of signals: one row per frame, one column per signal of the DBC.
//
//   time_s,bus,message,Sensors1.y1,Sensors1.y2,Commands1.u1
//   1436509052.249713,vcan0,Sensors1,1.5,-1,
//
// A cell is empty where the frame does not carry the signal. Read back, each row is the frame that
// encodes its cells; bits that no signal describes are zero, values that do not fit are clamped.

/// Whether `head`, the start of a file, is that of such a CSV.
[[nodiscard]] bool is_signal_csv(std::string_view head) noexcept;

/// Has columns for `messages` alone. @throws OutputError
[[nodiscard]] std::unique_ptr<FrameLogWriter> open_signal_csv(const std::string& file,
                                                              const DbcDatabase& dbc,
                                                              const MessageSet& messages);

/// Makes frames of rows.
class SignalCsvReader {
 public:
  /// @param head the first line. @throws FrameLogError a column is no signal of `dbc`.
  SignalCsvReader(std::string_view head, const std::string& source, const DbcDatabase& dbc);
  ~SignalCsvReader();
  SignalCsvReader(const SignalCsvReader&) = delete;
  SignalCsvReader& operator=(const SignalCsvReader&) = delete;

  /// @return "" and the frame, or "line:column: found ..., expected ..." of what is wrong.
  [[nodiscard]] std::string read(std::string_view row, std::uint64_t line, CanFrame& frame,
                                 std::string_view& bus);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

#pragma once

#include <memory>

namespace faultline {

/// SIGINT and SIGTERM as a question: has somebody asked to stop? While one exists, these signals do
/// not end the process. One at a time, on one thread.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  /// The signal that asked to stop, 0 if none did.
  [[nodiscard]] int poll();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline

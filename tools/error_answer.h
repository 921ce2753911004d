#pragma once

#include <string>

namespace faultline {

/// What an exception means to the user of a command.
struct ErrorAnswer {
  std::string text;
  int exit_code = 0;  ///< an ExitCode
};

/// The one place where exceptions become messages and exit codes.
/// @pre an exception is being handled
[[nodiscard]] ErrorAnswer answer_current_exception();

}  // namespace faultline

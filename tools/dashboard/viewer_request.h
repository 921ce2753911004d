#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

#include <faultline/inject_t.hpp>

namespace faultline {

/// What a viewer sent cannot be done; what() says what was found and what was expected.
class ViewerRequestError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Longest message of a viewer.
inline constexpr std::size_t kLongestRequest = 4096;

/// A viewer's message as a request to the bench. JSON, strict:
///
///   {"type": "inject", "target": "u2", "kind": "bias", "value": 2.0}    value optional
///   {"type": "clear", "target": "u2"}                                   all faults without a
///   target
///
/// The request's name, time and number are left to the caller; the bench checks what it names.
/// @throws ViewerRequestError anything else.
[[nodiscard]] inject_t parse_viewer_request(std::string_view text);

}  // namespace faultline

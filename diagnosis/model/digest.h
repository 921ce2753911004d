#pragma once

#include <string>
#include <string_view>

namespace faultline {

/// Name-based digest (RFC 4122, version 5, in a namespace of Faultline's own) of a text.
/// Equal texts, and in practice only they, have equal digests.
[[nodiscard]] std::string text_digest(std::string_view text);

}  // namespace faultline

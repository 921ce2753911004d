#pragma once

#include <cstdint>

namespace faultline {

/// Calls of the current thread to operator new and delete so far. Whoever links this file has those
/// operators replaced by ones that count: the program `faultline` does, so that a run in real time
/// can say how often its diagnosis thread went to the heap.
[[nodiscard]] std::uint64_t thread_allocations() noexcept;

}  // namespace faultline

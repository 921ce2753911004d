// Linked into tests that run scenarios: each designs its bank itself. A bank that an older build
// left in the user's cache would hide a broken design, and a test leaves nothing in the user's
// home.
#include <stdlib.h>

#include <gtest/gtest.h>

#include "tools/bench/bank_cache.h"

namespace faultline {
namespace {

class NoBankCache final : public testing::Environment {
  void SetUp() override {
    ::unsetenv("XDG_CACHE_HOME");
    ::unsetenv("HOME");
    ASSERT_TRUE(bank_cache_folder().empty());
  }
};

const testing::Environment* const kNoBankCache = testing::AddGlobalTestEnvironment(new NoBankCache);

}  // namespace
}  // namespace faultline

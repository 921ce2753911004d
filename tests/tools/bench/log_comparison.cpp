#include "tests/tools/bench/log_comparison.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include <stdlib.h>

#include <faultline/residual_t.hpp>

#include "tools/lcm/channels.h"

namespace faultline {
namespace {

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

}  // namespace

std::vector<LoggedResidual> logged_residuals(const std::filesystem::path& file) {
  std::vector<LoggedResidual> found;
  for (const residual_t& message : logged_messages<residual_t>(file, kResidualChannel)) {
    found.push_back({message.cycle, message.residual, message.evaluation, message.fired});
  }
  return found;
}

std::size_t first_difference(const std::vector<LoggedResidual>& a,
                             const std::vector<LoggedResidual>& b) {
  const std::size_t common = std::min(a.size(), b.size());
  for (std::size_t i = 0; i < common; ++i) {
    if (a[i].cycle != b[i].cycle || !same_bits(a[i].residual, b[i].residual) ||
        !same_bits(a[i].evaluation, b[i].evaluation) || a[i].fired != b[i].fired) {
      return i;
    }
  }
  return common;
}

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "faultline-test-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make " + name);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace faultline

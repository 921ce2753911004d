#include "tools/bank_print.h"

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace faultline {
namespace {

std::string cell_text(const ResidualFilter& filter, std::size_t fault) {
  switch (filter.sees[fault]) {
    case Sensitivity::kNone:
      return ".";
    case Sensitivity::kTransient:
      return "~";
    case Sensitivity::kSteady:
      break;
  }
  return fmt::format("{:.3g}", filter.certificate.dc_gain[fault]);
}

std::size_t name_width(const Bank& bank) {
  std::size_t width = 8;
  for (const ResidualFilter& filter : bank.filters) width = std::max(width, filter.name.size());
  return width;
}

}  // namespace

void print_bank(std::FILE* out, const Bank& bank) {
  fmt::print(out,
             "\n  method {}, {} residuals, isolates up to {} fault{} at a time, one step every "
             "{:g} s\n  fires above its threshold for {} samples; a verdict needs its signature to "
             "stand for {}\n\n",
             bank.method, bank.filters.size(), bank.concurrent, bank.concurrent == 1 ? "" : "s",
             bank.sample_time_s, bank.decision.dwell, bank.decision.settle);
  const std::size_t width = name_width(bank);
  fmt::print(out, "  {:<{}}", "residual", width);
  for (const std::string& fault : bank.fault_names) fmt::print(out, " {:>8}", fault);
  fmt::print(out, "   {:>9} {:>5} {:>7} {:>7}\n", "threshold", "order", "|pole|", "forgets");
  for (const ResidualFilter& filter : bank.filters) {
    fmt::print(out, "  {:<{}}", filter.name, width);
    for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
      fmt::print(out, " {:>8}", cell_text(filter, j));
    }
    fmt::print(out, "   {:>9.4g} {:>5} {:>7.4f} {:>5.2f} s\n", filter.threshold, filter.F.rows(),
               filter.certificate.spectral_radius, filter.forget_samples * bank.sample_time_s);
  }
  fmt::print(out,
             "\n  cells: gain from a constant fault of size one; . ignored; ~ seen only while "
             "it changes\n");
}

}  // namespace faultline

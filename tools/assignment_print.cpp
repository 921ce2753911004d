#include "tools/assignment_print.h"

#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "tools/wrapped_text.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kIndent = 13;
// More rows of W say nothing to an eye; the data (--json) has them.
constexpr Eigen::Index kFewRows = 2;

std::string ratio_text(double ratio) {
  return std::isfinite(ratio) ? fmt::format("{:.4g}", ratio) : "misses a fault";
}

void print_weakening(std::FILE* out, const WeakeningReport& weakening) {
  fmt::print(out, "{:{}}criterion {}, gain K: {}\n", "", kIndent, weakening.criterion,
             weakening.gain.empty() ? "none" : weakening.gain);
  fmt::print(out, "{:{}}singular values of the unknown inputs on the outputs: {:.4g}\n", "",
             kIndent, fmt::join(weakening.singular_values, ", "));
  if (weakening.rows > 0) {
    fmt::print(out,
               "{:{}}takes {:.4g} of them for zero; unknown inputs to the smallest fault: {}, "
               "before {}\n",
               "", kIndent, weakening.approximated, ratio_text(weakening.ratio_after),
               ratio_text(weakening.ratio_before));
  }
  fmt::print(out, "{:{}}  rows  {:>14}  {:>13}\n", "", kIndent, "to the fault", "low-rank cost");
  for (const RowsTrial& trial : weakening.trade_off) {
    fmt::print(out, "{:{}}{} {:>4}  {:>14}  {:>13.4g}\n", "", kIndent,
               trial.rows == weakening.rows ? '>' : ' ', trial.rows, ratio_text(trial.ratio),
               trial.low_rank_cost);
  }
}

// JSON knows no infinity.
Json ratio_json(double ratio) { return std::isfinite(ratio) ? Json(ratio) : Json(nullptr); }

Json weakening_json(const WeakeningReport& weakening) {
  Json trade_off = Json::array();
  for (const RowsTrial& trial : weakening.trade_off) {
    trade_off.push_back({{"rows", trial.rows},
                         {"ratio", ratio_json(trial.ratio)},
                         {"low_rank_cost", trial.low_rank_cost}});
  }
  return {{"criterion", weakening.criterion},
          {"gain", weakening.gain},
          {"singular_values", weakening.singular_values},
          {"rows", weakening.rows},
          {"approximated", weakening.approximated},
          {"ratio_before", ratio_json(weakening.ratio_before)},
          {"ratio_after", ratio_json(weakening.ratio_after)},
          {"trade_off", trade_off}};
}

Json zeros_json(const std::vector<std::complex<double>>& zeros) {
  Json json = Json::array();
  for (const std::complex<double> zero : zeros) json.push_back({zero.real(), zero.imag()});
  return json;
}

Json rows_json(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    const Eigen::VectorXd row = matrix.row(i).transpose();
    rows.push_back(std::vector<double>(row.begin(), row.end()));
  }
  return rows;
}

}  // namespace

void print_assignments(std::FILE* out, const DesignResult& result) {
  if (result.assignments.empty()) return;
  fmt::print(out, "\n  how unknown inputs are kept out\n");
  for (const EigenstructureReport& report : result.assignments) {
    const DecouplingExistence& existence = report.existence;
    fmt::print(out,
               "    {:<8} {}: rank C {}, rank CE {}, rank C W* {}; weights: {} dynamic, {} "
               "static\n",
               report.name, report.assignment.empty() ? "none" : report.assignment,
               existence.rank_C, existence.rank_CE, existence.rank_CW,
               existence.rank_C - existence.rank_CE, report.static_rows);
    print_wrapped(out, report.explanation, kIndent);
    for (Eigen::Index i = 0; report.W.rows() <= kFewRows && i < report.W.rows(); ++i) {
      const Eigen::VectorXd w = report.W.row(i).transpose();
      fmt::print(out, "{:{}}w = ({:.5g})\n", "", kIndent, fmt::join(w.begin(), w.end(), ", "));
    }
    for (const WeakeningReport& weakening : report.weakening) print_weakening(out, weakening);
  }
}

Json assignments_json(const DesignResult& result) {
  Json json = Json::array();
  for (const EigenstructureReport& report : result.assignments) {
    const DecouplingExistence& existence = report.existence;
    Json item{{"residual", report.name},
              {"assignment", report.assignment},
              {"explanation", report.explanation},
              {"rank_C", existence.rank_C},
              {"rank_CE", existence.rank_CE},
              {"rank_CW", existence.rank_CW},
              {"dynamic_weights", existence.rank_C - existence.rank_CE},
              {"static_weights", report.static_rows},
              {"left_rows", existence.left_rows},
              {"right_solvable", existence.is_right_solvable},
              {"zeros", zeros_json(existence.zeros)},
              {"W", rows_json(report.W)}};
    if (!report.weakening.empty()) item["weakening"] = weakening_json(report.weakening[0]);
    json.push_back(item);
  }
  return json;
}

}  // namespace faultline

#include "diagnosis/certify/findings.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// False if one of them is no number.
bool is_same(double stored, double recomputed, double noise) {
  return std::abs(stored - recomputed) <=
         kSameNumber * std::max(std::abs(stored), std::abs(recomputed)) + noise;
}

}  // namespace

std::string number_text(double value) { return fmt::format("{:.7g}", value); }

Findings::Findings(CheckResult& result, std::string subject)
    : result_(result), subject_(std::move(subject)) {}

void Findings::add(std::string claim, std::string stored, std::string recomputed) {
  result_.findings.push_back(
      {subject_, std::move(claim), std::move(stored), std::move(recomputed)});
}

void Findings::compare(const std::string& claim, double stored, double recomputed, double noise) {
  if (!is_same(stored, recomputed, noise)) {
    add(claim, number_text(stored), number_text(recomputed));
  }
}

void Findings::compare(const std::string& claim, const MatrixXd& stored, const MatrixXd& recomputed,
                       double noise) {
  if (stored.rows() != recomputed.rows() || stored.cols() != recomputed.cols()) {
    add(claim, fmt::format("{}x{} numbers", stored.rows(), stored.cols()),
        fmt::format("{}x{}", recomputed.rows(), recomputed.cols()));
    return;
  }
  Index count = 0;
  Index row = 0, column = 0;
  double worst = -1.0;
  for (Index i = 0; i < stored.rows(); ++i) {
    for (Index j = 0; j < stored.cols(); ++j) {
      if (is_same(stored(i, j), recomputed(i, j), noise)) continue;
      ++count;
      const double difference = std::abs(stored(i, j) - recomputed(i, j));
      if (!(difference <= worst)) {
        worst = difference;
        row = i;
        column = j;
      }
    }
  }
  if (count == 0) return;
  const std::string others = count > 1 ? fmt::format(" (and {} others)", count - 1) : "";
  add(fmt::format("{}({}, {}){}", claim, row, column, others), number_text(stored(row, column)),
      number_text(recomputed(row, column)));
}

void Findings::compare_courses(const std::string& claim, const Eigen::MatrixXd& stored,
                               const Eigen::MatrixXd& recomputed) {
  if (stored.rows() == 0 || recomputed.rows() == 0 || stored.cols() != recomputed.cols()) {
    compare(claim, stored, recomputed, 0.0);
    return;
  }
  const Eigen::Index rows = std::max(stored.rows(), recomputed.rows());
  const auto held = [rows](const Eigen::MatrixXd& course) {
    Eigen::MatrixXd longer(rows, course.cols());
    for (Eigen::Index k = 0; k < rows; ++k) {
      longer.row(k) = course.row(std::min(k, course.rows() - 1));
    }
    return longer;
  };
  compare(claim, held(stored), held(recomputed), 0.0);
}

void Findings::compare_exactly(const std::string& claim, double stored, double recomputed) {
  if (stored != recomputed) {
    add(claim, fmt::format("{}", stored), fmt::format("{}", recomputed));
  }
}

void Findings::compare_exactly(const std::string& claim, const std::string& stored,
                               const std::string& recomputed) {
  if (stored != recomputed) {
    add(claim, fmt::format("\"{}\"", stored), fmt::format("\"{}\"", recomputed));
  }
}

void Findings::compare_exactly(const std::string& claim, const std::vector<std::string>& stored,
                               const std::vector<std::string>& recomputed) {
  compare_exactly(claim, fmt::format("{}", fmt::join(stored, "\", \"")),
                  fmt::format("{}", fmt::join(recomputed, "\", \"")));
}

}  // namespace faultline

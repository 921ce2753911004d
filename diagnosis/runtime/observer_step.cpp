#include "diagnosis/runtime/observer_step.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace faultline {
namespace {

std::vector<double> by_rows(const Eigen::MatrixXd& matrix) {
  std::vector<double> numbers;
  for (const auto& row : matrix.rowwise()) numbers.insert(numbers.end(), row.begin(), row.end());
  return numbers;
}

}  // namespace

NonlinearTerm::NonlinearTerm(const FilterNonlinearity& term)
    : function_(term.function),
      center_(term.center),
      W_(term.W.begin(), term.W.end()),
      a_v_(term.a_v.begin(), term.a_v.end()),
      a_channels_(term.a_y.begin(), term.a_y.end()) {
  assert(W_.size() == a_v_.size());
  a_channels_.insert(a_channels_.end(), term.a_u.begin(), term.a_u.end());
}

CourseEvaluation::CourseEvaluation(const ResidualFilter& filter)
    : evaluation_(filter.evaluation),
      row_count_(static_cast<std::size_t>(filter.H.rows())),
      weight_(by_rows(filter.course->weight)),
      norm_(filter.course->norm.begin(), filter.course->norm.end()),
      component_(by_rows(filter.course->component)) {
  assert(!norm_.empty() && weight_.size() == row_count_ * row_count_ &&
         component_.size() == norm_.size() * row_count_);
}

double CourseEvaluation::threshold(std::size_t k) const noexcept {
  return evaluation_ == Evaluation::kComponent ? 1.0 : norm_[std::min(k, norm_.size() - 1)];
}

std::span<const double> CourseEvaluation::rows(std::size_t k) const noexcept {
  return std::span(component_).subspan(std::min(k, norm_.size() - 1) * row_count_, row_count_);
}

double CourseEvaluation::evaluate(std::span<const double> r, std::size_t k) const noexcept {
  return evaluation_ == Evaluation::kComponent ? largest_share(r, rows(k)) : weighted_norm(r);
}

double CourseEvaluation::weighted_norm(std::span<const double> r) const noexcept {
  double sum_of_squares = 0.0;
  const double* weight = weight_.data();
  for (std::size_t i = 0; i < row_count_; ++i) {
    double weighted = 0.0;
    for (const double value : r) weighted += *weight++ * value;
    sum_of_squares += weighted * weighted;
  }
  return std::sqrt(sum_of_squares);
}

double CourseEvaluation::largest_share(std::span<const double> r,
                                       std::span<const double> bound) const noexcept {
  double largest = 0.0;
  for (std::size_t i = 0; i < row_count_; ++i) {
    const double share = std::abs(r[i]) / bound[i];
    if (std::isnan(share)) return share;
    largest = std::max(largest, share);
  }
  return largest;
}

}  // namespace faultline

#include "diagnosis/certify/residual_evaluation.h"

#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace faultline {

using Eigen::MatrixXd;
using Eigen::VectorXd;

ResidualEvaluation::ResidualEvaluation(const ResidualFilter& filter)
    : evaluation_(filter.evaluation), threshold_(filter.threshold) {
  const Eigen::Index rows = filter.H.rows();
  if (filter.test) {
    const SequentialTest& test = *filter.test;
    const double reference = test.kind == TestKind::kCusum
                                 ? test.reference
                                 : std::sqrt(2.0 * filter.threshold / test.window);
    evaluation_ = Evaluation::kComponent;
    component_ = VectorXd::Map(test.offset.data(), std::ssize(test.offset)).array() + reference;
    threshold_ = 1.0;
    return;
  }
  if (filter.course && filter.course->weight.size() > 0) weight_ = filter.course->weight;
  if (weight_.size() > 0 && (weight_.rows() != rows || weight_.cols() != rows)) {
    throw std::invalid_argument(
        fmt::format("residual {}: found a weight of {}x{} numbers, expected "
                    "{}x{}",
                    filter.name, weight_.rows(), weight_.cols(), rows, rows));
  }
  size_of_weight_ = weight_.cwiseAbs();
  if (evaluation_ == Evaluation::kNorm) return;
  if (!filter.course || filter.course->component.cols() != rows ||
      filter.course->component.rows() == 0) {
    throw std::invalid_argument(
        fmt::format("residual {}: found no thresholds for each of its {} "
                    "rows, expected them: it is evaluated row by row",
                    filter.name, rows));
  }
  component_ = filter.course->component.bottomRows(1).transpose();
}

ResidualEvaluation::ResidualEvaluation(Evaluation evaluation, MatrixXd weight, VectorXd component,
                                       double norm)
    : evaluation_(evaluation),
      weight_(std::move(weight)),
      size_of_weight_(weight_.cwiseAbs()),
      component_(std::move(component)),
      threshold_(evaluation == Evaluation::kComponent ? 1.0 : norm) {}

double ResidualEvaluation::of(const VectorXd& r) const {
  if (evaluation_ == Evaluation::kComponent) {
    return (r.array().abs() / component_.array()).maxCoeff();
  }
  return weight_.size() == 0 ? r.norm() : (weight_ * r).norm();
}

double ResidualEvaluation::largest(const VectorXd& rows) const {
  if (evaluation_ == Evaluation::kComponent || weight_.size() == 0) return of(rows);
  return (size_of_weight_ * rows).norm();
}

}  // namespace faultline

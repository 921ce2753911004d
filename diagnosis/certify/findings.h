#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/certify/check.h"

namespace faultline {

/// Numbers of a certificate that agree this far are equal: other compilers and libraries round
/// differently, and no filter depends on the seventh digit.
inline constexpr double kSameNumber = 1e-6;

/// Seven digits.
[[nodiscard]] std::string number_text(double value);

/// Collects what does not hold of one subject: "bank", or a residual's name.
class Findings {
 public:
  /// `result` must outlive the findings.
  Findings(CheckResult& result, std::string subject);

  void add(std::string claim, std::string stored, std::string recomputed);
  /// Unless they differ by at most kSameNumber of the larger one and `noise`.
  void compare(const std::string& claim, double stored, double recomputed, double noise);
  /// Entry by entry, each to kSameNumber of itself and `noise`; the worst is told. Shapes must be
  /// equal, too.
  void compare(const std::string& claim, const Eigen::MatrixXd& stored,
               const Eigen::MatrixXd& recomputed, double noise);
  /// Row by row; of a course the last row holds for all later ones.
  void compare_courses(const std::string& claim, const Eigen::MatrixXd& stored,
                       const Eigen::MatrixXd& recomputed);
  void compare_exactly(const std::string& claim, double stored, double recomputed);
  void compare_exactly(const std::string& claim, const std::string& stored,
                       const std::string& recomputed);
  void compare_exactly(const std::string& claim, const std::vector<std::string>& stored,
                       const std::vector<std::string>& recomputed);

 private:
  CheckResult& result_;
  std::string subject_;
};

}  // namespace faultline

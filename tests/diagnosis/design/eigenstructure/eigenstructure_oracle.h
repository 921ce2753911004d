#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

namespace faultline {

/// tests/golden/eigenstructure/eigenstructure_reference.json.
[[nodiscard]] const nlohmann::json& eigenstructure_oracle();

/// A list of rows; a flat list is one row.
[[nodiscard]] Eigen::MatrixXd oracle_matrix(const nlohmann::json& rows);
[[nodiscard]] std::vector<std::complex<double>> oracle_poles(const nlohmann::json& values);

/// Orthogonal projector on the row space of X, whose rows are independent.
[[nodiscard]] Eigen::MatrixXd row_projector(const Eigen::MatrixXd& X);

/// The example of the paper in which CE = [h M b] has full row rank: C, E of `ex4`.
struct PaperExample {
  Eigen::MatrixXd C, E;
};
[[nodiscard]] PaperExample paper_example(const char* name, const char* E_key = "E");

}  // namespace faultline

#include "tests/diagnosis/design/eigenstructure/eigenstructure_oracle.h"

#include <fstream>
#include <stdexcept>

#include <Eigen/QR>

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;

const nlohmann::json& eigenstructure_oracle() {
  static const nlohmann::json oracle = [] {
    std::ifstream file(FAULTLINE_GOLDEN_DIR "/eigenstructure/eigenstructure_reference.json");
    if (!file) throw std::runtime_error("no golden file of the eigenstructure oracle");
    return nlohmann::json::parse(file);
  }();
  return oracle;
}

MatrixXd oracle_matrix(const nlohmann::json& rows) {
  const bool is_flat = !rows.at(0).is_array();
  const Index row_count = is_flat ? 1 : static_cast<Index>(rows.size());
  const auto col_count = static_cast<Index>(is_flat ? rows.size() : rows.at(0).size());
  MatrixXd matrix(row_count, col_count);
  for (Index i = 0; i < row_count; ++i) {
    const nlohmann::json& row = is_flat ? rows : rows.at(static_cast<std::size_t>(i));
    for (Index j = 0; j < col_count; ++j) matrix(i, j) = row.at(static_cast<std::size_t>(j));
  }
  return matrix;
}

std::vector<std::complex<double>> oracle_poles(const nlohmann::json& values) {
  std::vector<std::complex<double>> poles;
  for (const nlohmann::json& value : values) poles.emplace_back(value.get<double>(), 0.0);
  return poles;
}

MatrixXd row_projector(const MatrixXd& X) {
  const Eigen::HouseholderQR<MatrixXd> qr(X.transpose());
  const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(X.cols(), X.rows());
  return Q * Q.transpose();
}

PaperExample paper_example(const char* name, const char* E_key) {
  const nlohmann::json& example = eigenstructure_oracle().at(name);
  const nlohmann::json& with_C =
      example.contains("C") ? example : eigenstructure_oracle().at("ex1");
  return {oracle_matrix(with_C.at("C")), oracle_matrix(example.at(E_key))};
}

}  // namespace faultline

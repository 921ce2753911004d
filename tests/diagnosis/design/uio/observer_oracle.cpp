#include "tests/diagnosis/design/uio/observer_oracle.h"

#include <fstream>

#include <Eigen/QR>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

using nlohmann::json;

Eigen::MatrixXd matrix(const json& rows) {
  Eigen::MatrixXd M(rows.size(), rows.at(0).size());
  for (Eigen::Index i = 0; i < M.rows(); ++i) {
    for (Eigen::Index j = 0; j < M.cols(); ++j) {
      M(i, j) = rows.at(static_cast<std::size_t>(i)).at(static_cast<std::size_t>(j));
    }
  }
  return M;
}

Eigen::VectorXd vector(const json& entries) {
  Eigen::VectorXd v(entries.size());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = entries.at(static_cast<std::size_t>(i));
  return v;
}

/// T = D_1 (C D_1)⁺, S = I - T C.
DecouplingMatrices decoupling_of(const Eigen::MatrixXd& D_1, const Eigen::MatrixXd& C) {
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(C.cols(), C.rows());
  if (D_1.cols() > 0) {
    T = D_1 * (C * D_1).completeOrthogonalDecomposition().pseudoInverse();
  }
  return {T, Eigen::MatrixXd::Identity(C.cols(), C.cols()) - T * C, D_1};
}

}  // namespace

ObserverOracle observer_oracle(const std::string& name) {
  std::ifstream file(FAULTLINE_GOLDEN_DIR "/uio/uio_cases.json");
  const json golden = json::parse(file).at(name);
  const json& in = golden.at("inputs");
  ObserverOracle oracle;
  ObserverModel& model = oracle.model;
  model.A = matrix(in.at("A"));
  model.C = matrix(in.at("H"));
  const Eigen::MatrixXd M = matrix(in.at("M"));
  const Eigen::MatrixXd D_s = matrix(in.at("Ds"));
  const Eigen::Index n = M.rows();
  const Eigen::Index q = D_s.rows();
  model.M.resize(n, M.cols() + D_s.cols());
  model.M << M, Eigen::MatrixXd::Zero(n, D_s.cols());
  model.W.resize(q, M.cols() + D_s.cols());
  model.W << Eigen::MatrixXd::Zero(q, M.cols()), D_s;
  model.w_bound.resize(M.cols() + D_s.cols());
  model.w_bound << vector(in.at("wz")), Eigen::VectorXd::Constant(D_s.cols(), in.at("ws"));
  model.F_x = matrix(in.at("Fa"));
  model.F_y = Eigen::MatrixXd::Zero(q, model.F_x.cols());
  model.E_o = matrix(in.at("Eo"));
  model.E_i = matrix(in.at("Ei"));
  model.slope_radius = Eigen::VectorXd::Constant(model.E_o.cols(), in.at("lam"));
  model.x_bound = Eigen::VectorXd::Ones(n);
  oracle.decoupling = decoupling_of(matrix(in.at("D1")), model.C);

  oracle.output.R = matrix(in.at("Cr"));
  const Eigen::MatrixXd D_rs = matrix(in.at("Drs"));
  oracle.output.Q.resize(D_rs.rows(), M.cols() + D_rs.cols());
  oracle.output.Q << Eigen::MatrixXd::Zero(D_rs.rows(), M.cols()), D_rs;
  oracle.output.J = Eigen::MatrixXd::Zero(D_rs.rows(), model.F_x.cols());
  oracle.alpha = in.at("alpha");
  oracle.band = {0.0, in.at("band").at(1)};
  if (golden.contains("multiplier")) {
    oracle.reference = {golden.at("multiplier").at("a0"), matrix(golden.at("multiplier").at("V0"))};
  }
  oracle.objective = golden.value("expected_objective_JthOverBeta", 0.0);
  if (golden.contains("solution")) {
    const json& solution = golden.at("solution");
    oracle.gain = matrix(solution.at("F"));
    const json& checks = solution.at("checks");
    if (checks.contains("beta_gkyp_exact_vertices")) {
      oracle.beta = vector(checks.at("beta_gkyp_exact_vertices"));
    }
    oracle.J_th = checks.value("Jth_asymptotic_quadratic", 0.0);
  }
  return oracle;
}

}  // namespace faultline

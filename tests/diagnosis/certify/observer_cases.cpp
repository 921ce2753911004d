#include "tests/diagnosis/certify/observer_cases.h"

#include <fstream>

#include <Eigen/LU>

#include "diagnosis/model/discretize.h"

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Json = nlohmann::json;

namespace {

const Json& golden() {
  static const Json cases =
      Json::parse(std::ifstream(std::string(FAULTLINE_GOLDEN_DIR) + "/uio/l1_cases.json"));
  return cases;
}

MatrixXd stacked(const MatrixXd& top, Index zeros) {
  MatrixXd more = MatrixXd::Zero(top.rows() + zeros, top.cols());
  more.topRows(top.rows()) = top;
  return more;
}

// The plant in the bank's domain, as the observer has it: written down once more.
struct Equations {
  MatrixXd A, B, C, D, E_o, E_i, F_x, F_y;
};

// v+ = N v + (Γ + N T)(y - D u) + S B u + Σ S E_o gain (φ(s) - c s), x̂ = v + T (y - D u).
ResidualFilter output_filter(const PlantModel& plant, const Equations& eq, const MatrixXd& T,
                             const MatrixXd& gain) {
  const MatrixXd S = MatrixXd::Identity(eq.A.rows(), eq.A.rows()) - T * eq.C;
  const MatrixXd I = MatrixXd::Identity(eq.C.rows(), eq.C.rows());
  ResidualFilter filter;
  filter.name = "output";
  filter.F = S * eq.A - gain * eq.C;
  filter.E = -(gain + filter.F * T);
  filter.G = S * eq.B + filter.E * eq.D;
  filter.M = -eq.C;
  filter.H = -(I - eq.C * T);
  filter.K = filter.H * eq.D;
  filter.L = S * eq.F_x + filter.E * eq.F_y;
  filter.J = filter.H * eq.F_y;
  filter.evaluation = Evaluation::kComponent;
  filter.observer.emplace();
  filter.observer->T = T;
  filter.observer->gain = gain;
  for (Index i = 0; i < eq.E_o.cols(); ++i) {
    const Nonlinearity& term = plant.nonlinearities[static_cast<std::size_t>(i)];
    const VectorXd a_v = eq.E_i.row(i).transpose();
    const VectorXd a_y = T.transpose() * a_v;
    filter.nonlinearities.push_back({.function = term.function,
                                     .center = 0.5 * (term.slope_min + term.slope_max),
                                     .radius = 0.5 * (term.slope_max - term.slope_min),
                                     .W = S * (term.gain * eq.E_o.col(i)),
                                     .a_v = a_v,
                                     .a_y = a_y,
                                     .a_u = -eq.D.transpose() * a_y});
  }
  return filter;
}

ResidualFilter estimate_filter(ResidualFilter filter, const Equations& eq, std::size_t fault,
                               Index state) {
  filter.name = "estimate";
  filter.M = MatrixXd::Zero(1, filter.F.rows());
  filter.M(0, state) = 1.0;
  filter.H = -filter.observer->T.row(state);
  filter.K = filter.H * eq.D;
  filter.J = filter.H * eq.F_y;
  filter.estimation = FaultEstimation{.fault = fault};
  filter.course.reset();
  filter.observer->P.resize(0, 0);
  filter.observer->beta = 0.0;
  return filter;
}

Bank empty_bank(const PlantModel& plant, DesignDomain domain) {
  Bank bank;
  bank.name = "observers";
  bank.method = "uio";
  bank.plant_name = plant.name;
  bank.plant_digest = plant_digest(plant);
  bank.domain = domain;
  bank.sample_time_s = 0.01;
  bank.input_names = plant.input_names;
  bank.output_names = plant.output_names;
  bank.fault_names = plant.fault_names();
  for (const Fault& fault : plant.faults) bank.fault_sizes.push_back(fault.size);
  for (const Disturbance& disturbance : plant.disturbances) {
    bank.disturbances.push_back({disturbance.name, BankDisturbance::Treatment::kNone});
  }
  bank.u_operating = plant.u_operating;
  bank.y_operating = plant.y_operating;
  return bank;
}

// The fault of the first sensor as a state behind the plant's own.
void carry(Equations& eq, const VectorXd& output) {
  const Index n = eq.A.rows();
  MatrixXd A = MatrixXd::Identity(n + 1, n + 1);
  A.topLeftCorner(n, n) = eq.A;
  eq.A = A;
  MatrixXd C(eq.C.rows(), n + 1);
  C << eq.C, output;
  eq.C = C;
  eq.E_i.conservativeResizeLike(MatrixXd::Zero(eq.E_i.rows(), n + 1));
  for (MatrixXd* columns : {&eq.B, &eq.E_o, &eq.F_x}) *columns = stacked(*columns, 1);
}

}  // namespace

PlantModel joint_plant() {
  PlantModel plant;
  plant.name = "flexible joint";
  plant.state_names = {"angle", "speed", "link_angle", "link_speed"};
  plant.input_names = {"u"};
  plant.output_names = {"y1", "y2", "y3"};
  plant.A = MatrixXd{{0, 1, 0, 0}, {-48.6, -1.25, 48.6, 0}, {0, 0, 0, 10}, {1.95, 0, -1.95, 0}};
  plant.B = MatrixXd{{0}, {21.6}, {0}, {0}};
  plant.C = MatrixXd{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 1}};
  plant.D = MatrixXd::Zero(3, 1);
  plant.input_range = VectorXd::Constant(1, 2.0);
  plant.output_range = VectorXd::Constant(3, 10.0);
  plant.state_range = VectorXd{{0.15, 0, 0.2, 0.4}};
  plant.x_operating = VectorXd::Zero(4);
  plant.u_operating = VectorXd::Zero(1);
  plant.y_operating = VectorXd::Zero(3);
  plant.faults = {{"u", FaultKind::kActuator, plant.B.col(0), VectorXd::Zero(3), 0.2},
                  {"y1", FaultKind::kSensor, VectorXd::Zero(4), VectorXd::Unit(3, 0), 0.2}};
  plant.disturbances = {{"zd1", VectorXd{{-0.2, -0.1, 0.1, 0.2}}, VectorXd::Zero(3), 0.1},
                        {"zd2", VectorXd{{0.01, 0.02, -0.02, 0.02}}, VectorXd::Zero(3), 0.1},
                        {"zd3", VectorXd{{-0.02, -0.04, 0.04, -0.04}}, VectorXd::Zero(3), 0.1}};
  plant.noises = {{"noise1", VectorXd{{0.1, -0.02, 0.0}}, 0.1, {}}};
  plant.nonlinearities = {
      {{FunctionKind::kSin}, -0.333, VectorXd::Unit(4, 3), VectorXd::Unit(4, 2), -1.0, 1.0}};
  return plant;
}

ObserverCase ObserverCase::detection() {
  return {"paper_detection_UIO", golden().at("paper_detection_UIO")};
}
ObserverCase ObserverCase::combined() {
  return {"paper_combined_noDecoupling", golden().at("paper_combined_noDecoupling")};
}
ObserverCase ObserverCase::estimator() {
  return {"paper_sensor_fault_estimator_UIO", golden().at("paper_sensor_fault_estimator_UIO")};
}

MatrixXd ObserverCase::matrix(const std::string& path) const {
  Json value = numbers.at(Json::json_pointer("/" + path));
  if (!value.is_array()) value = Json::array({value});
  if (!value.at(0).is_array()) {
    const auto list = value.get<std::vector<double>>();
    return VectorXd::Map(list.data(), std::ssize(list));
  }
  MatrixXd matrix(std::ssize(value), std::ssize(value.at(0)));
  for (Index i = 0; i < matrix.rows(); ++i) {
    for (Index j = 0; j < matrix.cols(); ++j) {
      matrix(i, j) = value.at(static_cast<std::size_t>(i)).at(static_cast<std::size_t>(j));
    }
  }
  return matrix;
}

Bank ObserverCase::bank() const {
  const PlantModel plant = joint_plant();
  Bank bank = empty_bank(plant, DesignDomain::kEuler);
  constexpr double T_s = 0.01;
  Equations eq{MatrixXd::Identity(4, 4) + T_s * plant.A,
               T_s * plant.B,
               plant.C,
               plant.D,
               T_s * plant.nonlinearities[0].E_o,
               plant.nonlinearities[0].E_i.transpose(),
               MatrixXd::Zero(4, 2),
               MatrixXd::Zero(3, 2)};
  eq.F_x.col(0) = T_s * plant.faults[0].state;
  eq.F_y.col(1) = plant.faults[1].output;
  const bool is_carried = matrix("gain").rows() == 5;
  if (is_carried) carry(eq, plant.faults[1].output);
  const MatrixXd T = matrix("T");
  ResidualFilter filter = output_filter(plant, eq, T, matrix("gain"));
  if (!T.isZero(0.0)) {
    for (BankDisturbance& item : bank.disturbances) {
      item.treatment = BankDisturbance::Treatment::kDecoupled;
    }
  }
  filter.sees = {Sensitivity::kSteady, is_carried ? Sensitivity::kTransient : Sensitivity::kSteady};
  // Three outputs less two decoupled directions less one carried fault leave nothing at rest.
  if (is_carried && !T.isZero(0.0)) filter.sees[0] = Sensitivity::kTransient;
  ObserverCertificate& claims = *filter.observer;
  if (is_carried) {
    claims.fault_states = {1};
    claims.drift_bound = VectorXd::Constant(1, 0.001);
  }
  if (numbers.at("checks").contains("P")) {
    const Index s = is_carried ? 5 : 4;  // disturbances, noise, drift
    const VectorXd mu = matrix("checks/mu");
    claims.alpha = matrix("checks/alpha")(0, 0);
    claims.P = matrix("checks/P");
    claims.P = (0.5 * (claims.P + claims.P.transpose())).eval();
    claims.mu_now = claims.mu_next = claims.mu_direct = VectorXd::Zero(s);
    if (is_carried) {
      claims.mu_now.head(3) = mu.head(3);
      claims.mu_now[4] = mu[3];
    }
    claims.mu_now[3] = mu[mu.size() - 2];
    claims.mu_next[3] = mu[mu.size() - 1];
    claims.mu_direct[3] = matrix("checks/gamma2")(0, 0);
    claims.beta = matrix("checks/beta_design")(0, 0);
    claims.detects = {0};
    claims.band_high_rad = 0.1;
  }
  bank.filters = {filter};
  if (is_carried) {
    bank.filters.push_back(estimate_filter(filter, eq, 1, 4));
    bank.filters[1].sees = {Sensitivity::kSteady, Sensitivity::kSteady};
  }
  return bank;
}

PlantModel tanh_plant() {
  PlantModel plant;
  plant.name = "two tanks";
  plant.state_names = {"x1", "x2"};
  plant.input_names = {"u"};
  plant.output_names = {"y1", "y2"};
  plant.A = MatrixXd{{-2, 1}, {0, -3}};
  plant.B = MatrixXd{{0}, {1}};
  plant.C = MatrixXd::Identity(2, 2);
  plant.D = MatrixXd{{0}, {0.5}};
  plant.input_range = VectorXd::Constant(1, 1.0);
  plant.output_range = VectorXd::Constant(2, 5.0);
  plant.state_range = VectorXd{{1.0, 2.0}};
  plant.x_operating = VectorXd::Zero(2);
  plant.u_operating = VectorXd::Zero(1);
  plant.y_operating = VectorXd::Zero(2);
  plant.faults = {{"u", FaultKind::kActuator, plant.B.col(0), plant.D.col(0), 1.0},
                  {"y1", FaultKind::kSensor, VectorXd::Zero(2), VectorXd::Unit(2, 0), 0.5}};
  plant.disturbances = {{"d", VectorXd{{0.3, 0.1}}, VectorXd{{0.0, 0.02}}, 0.2}};
  plant.noises = {{"noise1", VectorXd::Unit(2, 0), 0.01, {}},
                  {"noise2", VectorXd::Unit(2, 1), 0.02, {}}};
  plant.nonlinearities = {
      {{FunctionKind::kTanh}, -2.0, VectorXd{{1.0, 0.5}}, VectorXd{{0.0, 1.0}}, 0.0, 1.0}};
  return plant;
}

Bank tanh_bank() {
  const PlantModel plant = tanh_plant();
  Bank bank = empty_bank(plant, DesignDomain::kSampled);
  MatrixXd columns(2, 2);
  columns << plant.B, plant.nonlinearities[0].E_o;
  const SampledSystem system = discretize_zoh(plant.A, columns, bank.sample_time_s);
  Equations eq{system.A,
               system.B.leftCols(1),
               plant.C,
               plant.D,
               system.B.rightCols(1),
               plant.nonlinearities[0].E_i.transpose(),
               MatrixXd::Zero(2, 2),
               MatrixXd::Zero(2, 2)};
  eq.A += -2.0 * 0.5 * eq.E_o * eq.E_i;
  eq.F_x.col(0) = eq.B;
  eq.F_y.col(0) = plant.D;
  eq.F_y.col(1) = plant.faults[1].output;
  carry(eq, plant.faults[1].output);
  const MatrixXd gain{{0.05, 0.01}, {0.02, 0.2}, {0.15, -0.02}};
  ResidualFilter filter = output_filter(plant, eq, MatrixXd::Zero(3, 2), gain);
  filter.sees = {Sensitivity::kSteady, Sensitivity::kTransient};
  filter.observer->fault_states = {1};
  filter.observer->drift_bound = VectorXd::Constant(1, 0.01);
  bank.filters = {filter, estimate_filter(filter, eq, 1, 2)};
  bank.filters[1].sees = {Sensitivity::kSteady, Sensitivity::kSteady};
  return bank;
}

}  // namespace faultline

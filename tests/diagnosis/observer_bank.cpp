#include "tests/diagnosis/observer_bank.h"

#include <cmath>

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kGainOfSin = 0.05;

ObserverCertificate certificate_of(const ResidualFilter& filter) {
  ObserverCertificate certificate;
  certificate.fault_states = {1};
  certificate.drift_bound = VectorXd::Constant(1, 0.001);
  certificate.T = MatrixXd::Zero(3, 2);
  certificate.gain = -filter.E;
  certificate.alpha = 0.9;
  certificate.P = MatrixXd::Identity(3, 3);
  certificate.P(0, 1) = certificate.P(1, 0) = 1.0 / 3.0;
  // w: two noises, one drift.
  certificate.mu_now = VectorXd::Constant(3, 0.1);
  certificate.mu_next = VectorXd::Zero(3);
  certificate.mu_direct = VectorXd::Unit(3, 0);
  certificate.beta = 0.7;
  certificate.detects = {0};
  certificate.band_low_rad = 0.0;
  certificate.band_high_rad = 0.1;
  certificate.vertex_radius = {0.81, 0.82};
  certificate.nominal_fault = {0.01, 0.0};
  certificate.guaranteed_fault = {0.02, 0.0};
  return certificate;
}

// What both filters share: v_k+1 and what faults do to it.
ResidualFilter observer() {
  MatrixXd A(3, 3), C(2, 3), gain(3, 2);
  A << 0.8, 0.1, 0.0, 0.2, 0.7, 0.0, 0.0, 0.0, 1.0;
  C << 1.0, 0.0, 1.0, 0.0, 1.0, 0.0;
  gain << 0.09, 0.17, 0.02, 0.32, 0.56, -0.17;
  ResidualFilter filter;
  filter.F = A - gain * C;
  filter.E = -gain;
  filter.G = VectorXd::Unit(3, 0);
  // Of f_u and f_y1.
  filter.L.resize(3, 2);
  filter.L << VectorXd::Unit(3, 0), -gain.col(0);
  FilterNonlinearity term;
  term.radius = 1.0;
  term.W = kGainOfSin * VectorXd::Unit(3, 0);
  term.a_v = VectorXd::Unit(3, 1);
  term.a_y = VectorXd::Zero(2);
  term.a_u = VectorXd::Zero(1);
  filter.nonlinearities = {term};
  filter.forget_samples = 20;
  filter.certificate.input_gain = {0.0};
  for (std::vector<double>* per_fault :
       {&filter.certificate.fault_gain, &filter.certificate.dc_gain, &filter.certificate.band_gain,
        &filter.certificate.margin, &filter.certificate.smallest_fault,
        &filter.certificate.delay_s}) {
    *per_fault = {0.5, 0.25};
  }
  filter.observer = certificate_of(filter);
  return filter;
}

ResidualFilter detection() {
  ResidualFilter filter = observer();
  filter.name = "detection";
  filter.sees = {Sensitivity::kSteady, Sensitivity::kTransient};
  filter.M.resize(2, 3);
  filter.M << -1.0, 0.0, -1.0, 0.0, -1.0, 0.0;
  filter.H = -MatrixXd::Identity(2, 2);
  filter.K = MatrixXd::Zero(2, 1);
  filter.J.resize(2, 2);
  filter.J << 0.0, -1.0, 0.0, 0.0;
  filter.evaluation = Evaluation::kComponent;
  filter.threshold = 1.0;
  filter.transient_samples = 10;
  ThresholdCourse course;
  course.weight = MatrixXd::Identity(2, 2);
  course.norm.resize(4);
  course.norm << 0.2, 0.1, 0.05, 0.006;
  course.component.resize(4, 2);
  course.component << 0.2, 0.1, 0.05, 0.03, 0.01, 0.01, 0.004, 0.004;
  filter.course = course;
  return filter;
}

ResidualFilter estimate() {
  ResidualFilter filter = observer();
  filter.name = "estimate";
  filter.sees = {Sensitivity::kSteady, Sensitivity::kSteady};
  filter.M = Eigen::RowVector3d::Unit(2);
  filter.H = MatrixXd::Zero(1, 2);
  filter.K = MatrixXd::Zero(1, 1);
  filter.J = MatrixXd::Zero(1, 2);
  ThresholdCourse course;
  course.weight = MatrixXd::Constant(1, 1, 1.0);
  course.norm.resize(3);
  course.norm << 0.2, 0.05, 0.02;
  course.component = course.norm;
  filter.course = course;
  filter.threshold = 0.02;
  filter.estimation = FaultEstimation{1, 0.015, 8};
  return filter;
}

}  // namespace

Bank observer_bank() {
  Bank bank;
  bank.name = "observers";
  bank.method = "uio";
  bank.plant_name = "by hand";
  bank.plant_digest = bank.request_digest = "0";
  bank.domain = DesignDomain::kSampled;
  bank.sample_time_s = 0.01;
  bank.input_names = {"u"};
  bank.output_names = {"y1", "y2"};
  bank.fault_names = {"u", "y1"};
  bank.fault_sizes = {1.0, 1.0};
  bank.u_operating = VectorXd::Zero(1);
  bank.y_operating = VectorXd::Zero(2);
  bank.decision = {.dwell = 2, .settle = 3, .window = 50};
  bank.filters = {detection(), estimate()};
  return bank;
}

void ObservedPlant::step(double u) {
  const double x1 = 0.8 * x1_ + 0.1 * x2_ + kGainOfSin * std::sin(x2_) + u + f_u;
  x2_ = 0.2 * x1_ + 0.7 * x2_;
  x1_ = x1;
}

}  // namespace faultline

#include "diagnosis/design/design_model.h"

#include <cstddef>

#include "diagnosis/design/requested_disturbances.h"
#include "diagnosis/design/with_rows.h"
#include "diagnosis/model/discretize.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

Directions fault_directions(const PlantModel& plant) {
  const auto count = std::ssize(plant.faults);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  Index j = 0;
  for (const Fault& fault : plant.faults) {
    directions.state.col(j) = fault.state;
    directions.output.col(j++) = fault.output;
  }
  return directions;
}

// Directions of the disturbances with one treatment.
Directions treated_disturbances(const PlantModel& plant,
                                const std::vector<BankDisturbance>& treatments,
                                BankDisturbance::Treatment treatment) {
  std::vector<Index> treated;
  for (std::size_t i = 0; i < treatments.size(); ++i) {
    if (treatments[i].treatment == treatment) {
      treated.push_back(static_cast<Index>(i));
    }
  }
  Directions directions{MatrixXd(plant.n(), std::ssize(treated)),
                        MatrixXd(plant.q(), std::ssize(treated))};
  Index column = 0;
  for (const Index i : treated) {
    const Disturbance& disturbance = plant.disturbances[static_cast<std::size_t>(i)];
    // What is to be small is so against its bound.
    const double size =
        treatment == BankDisturbance::Treatment::kWeakened ? disturbance.bound.value_or(1.0) : 1.0;
    directions.state.col(column) = size * disturbance.state;
    directions.output.col(column++) = size * disturbance.output;
  }
  return directions;
}

// All inputs of the sampled plant are held over a sample, faults and disturbances too.
void sample(DesignModel& model, const BankRequest& request) {
  const Index m = model.B.cols();
  const Index k = model.faults.state.cols();
  const Index l = model.decoupled.state.cols();
  const Index w = model.weakened.state.cols();
  MatrixXd inputs(model.A.rows(), m + k + l + w);
  inputs << model.B, model.faults.state, model.decoupled.state, model.weakened.state;
  const SampledSystem sampled = request.domain == DesignDomain::kEuler
                                    ? discretize_euler(model.A, inputs, request.sample_time_s)
                                    : discretize_zoh(model.A, inputs, request.sample_time_s);
  model.A = sampled.A;
  model.B = sampled.B.leftCols(m);
  model.faults.state = sampled.B.middleCols(m, k);
  model.decoupled.state = sampled.B.middleCols(m + k, l);
  model.weakened.state = sampled.B.rightCols(w);
}

// Constant disturbances become states.
void append_constants(DesignModel& model, const Directions& constants) {
  const Index n = model.A.rows();
  const Index total = n + constants.state.cols();
  MatrixXd A = MatrixXd::Zero(total, total);
  A.topLeftCorner(n, n) = model.A;
  A.topRightCorner(n, total - n) = constants.state;
  MatrixXd C(model.C.rows(), total);
  C << model.C, constants.output;
  model.A = A;
  model.C = C;
  for (MatrixXd* columns :
       {&model.B, &model.faults.state, &model.decoupled.state, &model.weakened.state}) {
    *columns = with_rows(*columns, total);
  }
}

}  // namespace

DesignModel design_model(const PlantModel& plant, const BankRequest& request) {
  using Treatment = BankDisturbance::Treatment;
  const std::vector<BankDisturbance> treatments = disturbance_treatments(plant, request);
  DesignModel model{plant.A,
                    plant.B,
                    plant.C,
                    plant.D,
                    fault_directions(plant),
                    treated_disturbances(plant, treatments, Treatment::kDecoupled),
                    treated_disturbances(plant, treatments, Treatment::kWeakened),
                    is_sampled(request.domain)};
  append_constants(model, treated_disturbances(plant, treatments, Treatment::kConstant));
  if (plant.time == TimeDomain::kDiscrete) {
    const Index constants = model.A.rows() - plant.n();
    model.A.bottomRightCorner(constants, constants).setIdentity();
  } else if (model.is_sampled) {
    sample(model, request);
  }
  return model;
}

Directions ignored_directions(const DesignModel& model, const FaultSet& ignores) {
  const auto count = std::ssize(ignores);
  const Index l = model.decoupled.state.cols();
  Directions directions{MatrixXd(model.A.rows(), count + l), MatrixXd(model.C.rows(), count + l)};
  Index i = 0;
  for (const std::size_t j : ignores) {
    directions.state.col(i) = model.faults.state.col(static_cast<Index>(j));
    directions.output.col(i++) = model.faults.output.col(static_cast<Index>(j));
  }
  directions.state.rightCols(l) = model.decoupled.state;
  directions.output.rightCols(l) = model.decoupled.output;
  return directions;
}

}  // namespace faultline

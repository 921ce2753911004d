#include "tests/diagnosis/threshold_trial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kSegment = 400;
// Of the inputs' range: what the reference moves the plant by.
constexpr double kReference = 0.05;

SampledSystem sampled(const PlantModel& plant, const Bank& bank, const MatrixXd& columns) {
  if (plant.time == TimeDomain::kDiscrete) return {plant.A, columns};
  return bank.domain == DesignDomain::kEuler
             ? discretize_euler(plant.A, columns, bank.sample_time_s)
             : discretize_zoh(plant.A, columns, bank.sample_time_s);
}

std::span<const double> span_of(const VectorXd& values) {
  return {values.data(), static_cast<std::size_t>(values.size())};
}

}  // namespace

ThresholdTrial::ThresholdTrial(const PlantModel& plant, const Bank& bank, std::uint64_t seed)
    : plant_(plant), bank_(bank), filters_(bank), draw_(seed) {
  const auto d = std::ssize(plant.disturbances);
  const auto e = std::ssize(plant.nonlinearities);
  MatrixXd columns(plant.n(), plant.m() + d + e);
  columns.leftCols(plant.m()) = plant.B;
  N_ = MatrixXd(plant.q(), std::ssize(plant.noises) + d);
  for (Index i = 0; i < d; ++i) {
    const Disturbance& one = plant.disturbances[static_cast<std::size_t>(i)];
    columns.col(plant.m() + i) = one.state * one.bound.value();
    N_.col(std::ssize(plant.noises) + i) = one.output * one.bound.value();
  }
  for (Index i = 0; i < e; ++i) {
    const Nonlinearity& term = plant.nonlinearities[static_cast<std::size_t>(i)];
    columns.col(plant.m() + d + i) = term.gain * term.E_o;
  }
  for (Index i = 0; i < std::ssize(plant.noises); ++i) {
    const Noise& noise = plant.noises[static_cast<std::size_t>(i)];
    N_.col(i) = noise.output * noise.bound.value();
  }
  const SampledSystem system = sampled(plant, bank, columns);
  A_ = system.A;
  B_ = system.B.leftCols(plant.m());
  E_ = system.B.middleCols(plant.m(), d);
  Eo_ = system.B.rightCols(e);
  half_lsb_ = VectorXd::Zero(plant.q());
  if (bank.thresholds.output_resolution.size() > 0)
    half_lsb_ = 0.5 * bank.thresholds.output_resolution;
  late_ = MatrixXd::Zero(plant.n(), plant.m());
  if (bank.thresholds.jitter_s > 0.0) {
    // The first part of the sample, then what is left of it.
    const double late = bank.thresholds.jitter_s;
    late_ = discretize_zoh(plant.A, plant.B, bank.sample_time_s - late).A *
            discretize_zoh(plant.A, plant.B, late).B;
  }
  K_ = lqr_gain(A_, B_, MatrixXd::Identity(plant.n(), plant.n()),
                MatrixXd::Identity(plant.m(), plant.m()));
  unknown_ = {VectorXd::Zero(d), VectorXd::Zero(std::ssize(plant.noises)),
              VectorXd::Zero(plant.q()), VectorXd::Zero(plant.m())};
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    filter_of_row_.insert(filter_of_row_.end(), static_cast<std::size_t>(bank.filters[f].H.rows()),
                          f);
  }
  x_ = VectorXd::Zero(plant.n());
  u_ = u_before_ = wanted_ = VectorXd::Zero(plant.m());
  if (plant.nonlinearities.empty()) find_responses();
}

// By experiment: one unknown at its bound for one sample, no feedback.
void ThresholdTrial::find_responses() {
  const Index d = unknown_.disturbance.size(), n = unknown_.noise.size();
  const Index count = d + n + plant_.q() + plant_.m();
  const std::size_t rows = filter_of_row_.size();
  response_.assign(rows, std::vector<VectorXd>(kSegment, VectorXd::Zero(count)));
  const MatrixXd K = std::exchange(K_, MatrixXd::Zero(K_.rows(), K_.cols()));
  for (Index i = 0; i < count; ++i) {
    filters_.reset();
    x_.setZero();
    u_.setZero();
    u_before_.setZero();
    for (std::size_t k = 0; k < kSegment; ++k) {
      VectorXd all = VectorXd::Zero(count);
      if (k == 0) all[i] = 1.0;
      Unknown unknown{all.head(d), all.segment(d, n), all.segment(d + n, plant_.q()),
                      VectorXd::Zero(plant_.m())};
      if (k == 0 && i >= d + n + plant_.q()) {
        // A command that acts late after the largest change there can be.
        x_ = late_.col(i - d - n - plant_.q()) * 2.0 * plant_.input_range[i - d - n - plant_.q()];
        continue;  // from the next sample on
      }
      step(unknown);
      const std::span<const double> residual = filters_.residual();
      for (std::size_t row = 0; row < rows; ++row) response_[row][k][i] = residual[row];
    }
  }
  K_ = K;
}

void ThresholdTrial::begin(Course course) {
  square_period_ =
      std::exp(std::uniform_real_distribution<double>(std::log(2.0), std::log(200.0))(draw_));
  const double amplitude = course == Course::kWorst ? 0.0 : kReference;
  for (Index i = 0; i < wanted_.size(); ++i) {
    wanted_[i] = amplitude * plant_.input_range[i] * (draw_() % 2 == 0 ? 1.0 : -1.0);
  }
  if (course == Course::kStart) {
    filters_.reset();
    for (Index i = 0; i < x_.size(); ++i) {
      x_[i] = plant_.state_range.value()[i] * (draw_() % 2 == 0 ? 1.0 : -1.0);
    }
    u_before_ = u_;
  }
}

void ThresholdTrial::choose(Course course, std::size_t k) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto fill = [&](VectorXd& values, Index first) {
    for (Index i = 0; i < values.size(); ++i) {
      switch (course) {
        case Course::kUniform:
        case Course::kStart:
          values[i] = uniform(draw_);
          break;
        case Course::kExtreme:
          values[i] = draw_() % 2 == 0 ? 1.0 : -1.0;
          break;
        case Course::kSquare:
          values[i] = std::fmod(static_cast<double>(k) / square_period_ +
                                    0.37 * static_cast<double>(first + i),
                                1.0) < 0.5
                          ? 1.0
                          : -1.0;
          break;
        case Course::kConstant:
          if (k == 0) values[i] = draw_() % 2 == 0 ? 1.0 : -1.0;
          break;
        case Course::kWorst:
          values[i] = response_[row_][kSegment - 1 - k][first + i] > 0.0 ? 1.0 : -1.0;
          break;
      }
    }
  };
  fill(unknown_.disturbance, 0);
  fill(unknown_.noise, unknown_.disturbance.size());
  fill(unknown_.rounding, unknown_.disturbance.size() + unknown_.noise.size());
  fill(unknown_.lateness, unknown_.disturbance.size() + unknown_.noise.size() + plant_.q());
}

void ThresholdTrial::step(const Unknown& unknown) {
  y_ = plant_.C * x_ + plant_.D * u_;
  y_ += N_.leftCols(unknown.noise.size()) * unknown.noise;
  y_ += N_.rightCols(unknown.disturbance.size()) * unknown.disturbance;
  y_ += half_lsb_.cwiseProduct(unknown.rounding);
  filters_.step(span_of(y_ + plant_.y_operating), span_of(u_ + plant_.u_operating));
  advance(unknown);
}

void ThresholdTrial::advance(const Unknown& unknown) {
  next_.noalias() = A_ * x_;
  next_.noalias() += B_ * u_;
  next_.noalias() += E_ * unknown.disturbance;
  for (Index i = 0; i < Eo_.cols(); ++i) {
    const Nonlinearity& term = plant_.nonlinearities[static_cast<std::size_t>(i)];
    next_ += Eo_.col(i) * evaluate(term.function, term.E_i.dot(x_));
  }
  // Late: what acts for the first part of the sample is the command before.
  if (bank_.thresholds.jitter_s > 0.0) {
    for (Index i = 0; i < u_.size(); ++i) {
      const double change = u_before_[i] - u_[i];
      if (unknown.lateness[i] > 0.0) next_ += late_.col(i) * change;
    }
  }
  x_.swap(next_);
  u_before_ = u_;
  u_ = (wanted_ - K_ * x_).cwiseMin(plant_.input_range).cwiseMax(-plant_.input_range);
}

ThresholdTrial::Result ThresholdTrial::run(std::uint64_t samples) {
  Result result;
  result.largest_of_worst.resize(bank_.filters.size());
  x_.setZero();
  u_.setZero();
  u_before_.setZero();
  filters_.reset();
  const std::size_t courses = response_.empty() ? 5 : 6;
  for (std::size_t segment = 0; result.samples < samples; ++segment) {
    const auto course = static_cast<Course>(segment % courses);
    if (course == Course::kWorst) row_ = segment / courses % filter_of_row_.size();
    begin(course);
    for (std::size_t k = 0; k < kSegment; ++k, ++result.samples) {
      choose(course, k);
      step(unknown_);
      double largest = 0.0;
      for (std::size_t f = 0; f < bank_.filters.size(); ++f) {
        const double share = filters_.evaluation()[f] / filters_.thresholds()[f];
        largest = std::max(largest, share);
        if (course == Course::kWorst && f == filter_of_row_[row_]) {
          result.largest_of_worst[f] = std::max(result.largest_of_worst[f], share);
        }
      }
      result.crossings += largest > 1.0 ? 1 : 0;
      result.largest = std::max(result.largest, largest);
    }
  }
  return result;
}

}  // namespace faultline

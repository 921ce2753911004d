#include "diagnosis/runtime/residual_bank.h"

#include <cmath>
#include <random>
#include <utility>

#include <gtest/gtest.h>

#include "tests/diagnosis/hou_plant.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class RandomBanks {
 public:
  explicit RandomBanks(std::uint64_t seed) : engine_(seed) {}

  MatrixXd matrix(Index rows, Index cols) {
    return MatrixXd::NullaryExpr(rows, cols, [this] { return normal_(engine_); });
  }
  /// `count` filters of orders 0..5 and 1..3 rows, all mixed.
  Bank bank(std::size_t count, Index q, Index m) {
    Bank bank;
    bank.output_names.resize(static_cast<std::size_t>(q));
    bank.input_names.resize(static_cast<std::size_t>(m));
    bank.y_operating = matrix(q, 1);
    bank.u_operating = matrix(m, 1);
    for (std::size_t i = 0; i < count; ++i) {
      const Index d = std::uniform_int_distribution<Index>(0, 5)(engine_);
      const Index rows = std::uniform_int_distribution<Index>(1, 3)(engine_);
      ResidualFilter filter;
      filter.F = 0.2 * matrix(d, d);
      filter.E = matrix(d, q);
      filter.G = matrix(d, m);
      filter.M = matrix(rows, d);
      filter.H = matrix(rows, q);
      filter.K = matrix(rows, m);
      bank.filters.push_back(filter);
    }
    return bank;
  }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

TEST(ResidualBank, FulfilsItsEquationsForFiltersOfAllShapes) {
  const std::uint64_t seed = test_seed(40);
  SCOPED_TRACE(seed_message(seed));
  RandomBanks random(seed);
  for (const std::size_t count : {1u, 7u, 8u, 9u, 30u}) {
    const Bank bank = random.bank(count, 3, 4);
    ResidualBank filters(bank);
    ASSERT_EQ(filters.filter_count(), count);
    ASSERT_EQ(filters.residual().size(), static_cast<std::size_t>(bank.residual_rows()));
    std::vector<VectorXd> v;
    for (const ResidualFilter& filter : bank.filters) {
      v.push_back(VectorXd::Zero(filter.F.rows()));
    }
    for (int k = 0; k < 20; ++k) {
      const VectorXd y = random.matrix(3, 1);
      const VectorXd u = random.matrix(4, 1);
      filters.step({y.data(), 3}, {u.data(), 4});
      std::size_t row = 0;
      for (std::size_t i = 0; i < count; ++i) {
        const ResidualFilter& f = bank.filters[i];
        const VectorXd dy = y - bank.y_operating;
        const VectorXd du = u - bank.u_operating;
        const VectorXd r = f.M * v[i] - f.H * dy + f.K * du;
        v[i] = (f.F * v[i] - f.E * dy + f.G * du).eval();
        EXPECT_NEAR(filters.evaluation()[i], r.norm(), 1e-12 * (1.0 + r.norm()));
        for (const double value : r) {
          EXPECT_NEAR(filters.residual()[row++], value, 1e-12 * (1.0 + r.norm()));
        }
      }
    }
  }
}

TEST(ResidualBank, StartsAgainAfterReset) {
  RandomBanks random(1);
  ResidualBank filters(random.bank(5, 2, 1));
  const std::vector<double> y = {1.0, -2.0};
  const std::vector<double> u = {0.5};
  filters.step(y, u);
  const std::vector<double> first(filters.residual().begin(), filters.residual().end());
  filters.step(y, u);
  filters.reset();
  for (const double value : filters.residual()) {
    EXPECT_EQ(value, 0.0);
  }
  filters.step(y, u);
  EXPECT_TRUE(std::equal(first.begin(), first.end(), filters.residual().begin()));
}

TEST(ResidualBank, GoesOnWhereItWasAfterAMove) {
  RandomBanks random(2);
  const Bank bank = random.bank(3, 2, 1);
  const std::vector<double> y = {1.0, -2.0};
  const std::vector<double> u = {0.5};
  ResidualBank a(bank), b(bank);
  a.step(y, u);
  b.step(y, u);
  ResidualBank moved = std::move(a);
  moved.step(y, u);
  b.step(y, u);
  EXPECT_TRUE(std::equal(b.residual().begin(), b.residual().end(), moved.residual().begin()));
}

TEST(ResidualBank, RunsAnEmptyBank) {
  ResidualBank filters{Bank()};
  filters.step({}, {});
  EXPECT_EQ(filters.filter_count(), 0u);
  EXPECT_TRUE(filters.residual().empty());
}

TEST(ResidualBank, DoesNotTouchTheHeapInAThousandSteps) {
  RandomBanks random(3);
  ResidualBank filters(random.bank(20, 3, 4));
  const VectorXd y = random.matrix(3, 1);
  const VectorXd u = random.matrix(4, 1);
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    filters.step({y.data(), 3}, {u.data(), 4});
    if (k % 100 == 0) {
      filters.reset();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

}  // namespace
}  // namespace faultline

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/design/lmi/lmi_problem.h"
#include "diagnosis/design/lmi/semidefinite_program.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The largest eigenvalue of A + P, P > 1: A random, n×n.
LmiProblem random_problem(std::uint64_t seed, Index n = 6) {
  RandomNumbers random(seed);
  const MatrixXd half = random.normal(n, n);
  LmiProblem problem;
  const AffineMatrix t = problem.scalar();
  const AffineMatrix P = problem.symmetric(n);
  problem.require_negative("A + P < t", AffineMatrix(half + half.transpose()) + P -
                                            multiple_of(MatrixXd::Identity(n, n), t));
  problem.require_positive("P > 1", P - AffineMatrix(MatrixXd::Identity(n, n)));
  problem.minimise(t);
  return problem;
}

/// A working directory of its own, left and removed in the end.
class InFolder {
 public:
  InFolder() : before_(std::filesystem::current_path()) {
    std::string name = (std::filesystem::temp_directory_path() / "faultline_csdp_XXXXXX").string();
    folder_ = mkdtemp(name.data());
    std::filesystem::current_path(folder_);
  }
  ~InFolder() {
    std::filesystem::current_path(before_);
    std::filesystem::remove_all(folder_);
  }

 private:
  std::filesystem::path before_, folder_;
};

TEST(CsdpSolver, ReadsNoParametersFromTheWorkingDirectory) {
  const LmiProblem problem = random_problem(1);
  const LmiSolution expected = solve(problem);
  ASSERT_TRUE(expected.is_solved());
  const InFolder folder;
  std::ofstream("param.csdp") << "axtol=1.0e-1\natytol=1.0e-1\nobjtol=1.0e-1\npinftol=1.0e1\n"
                                 "dinftol=1.0e1\nmaxiter=1\nminstepfrac=0.1\nmaxstepfrac=0.2\n"
                                 "minstepp=1.0e-1\nminstepd=1.0e-1\nusexzgap=0\ntweakgap=1\n"
                                 "affine=1\nprintlevel=1\nperturbobj=0\nfastmode=1\n";
  testing::internal::CaptureStdout();
  const LmiSolution solution = solve(problem);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  ASSERT_TRUE(solution.is_solved()) << solution.reason;
  EXPECT_EQ(solution.x, expected.x);
}

TEST(CsdpSolver, PrintsNothingWhateverTheOutcome) {
  LmiProblem infeasible;
  const AffineMatrix x = infeasible.scalar();
  infeasible.require_positive("x > 1", x - AffineMatrix(MatrixXd::Ones(1, 1)));
  infeasible.require_negative("x < 0", x);
  LmiProblem unbounded;
  const AffineMatrix y = unbounded.scalar();
  unbounded.require_negative("y < 1", y - AffineMatrix(MatrixXd::Ones(1, 1)));
  unbounded.minimise(y);
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  static_cast<void>(solve(infeasible));
  static_cast<void>(solve(unbounded));
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(CsdpSolver, GivesFourThreadsAtATimeTheAnswersOfOneAlone) {
  // Of different sizes, which the solver's static work array has to follow.
  constexpr std::uint64_t kProblems = 12;
  const auto size_of = [](std::uint64_t seed) { return 4 + static_cast<Index>(seed % 8); };
  std::vector<VectorXd> alone;
  for (std::uint64_t seed = 0; seed < kProblems; ++seed) {
    alone.push_back(solve(random_problem(seed, size_of(seed))).x);
    ASSERT_GT(alone.back().size(), 0);
  }
  std::vector<std::vector<VectorXd>> together(4);
  std::vector<std::thread> threads;
  for (std::vector<VectorXd>& answers : together) {
    threads.emplace_back([&answers, &size_of] {
      for (std::uint64_t seed = 0; seed < kProblems; ++seed) {
        answers.push_back(solve(random_problem(seed, size_of(seed))).x);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::vector<VectorXd>& answers : together) EXPECT_EQ(answers, alone);
}

TEST(CsdpSolver, SurvivesNumbersThatOverflow) {
  SemidefiniteProgram program;
  program.block_sizes = {2};
  program.c = VectorXd{{1e300, -1e300}};
  program.entries = {{-1, 0, 0, 0, 1e300}, {0, 0, 0, 0, 1e300}, {1, 0, 0, 1, 1e-300}};
  const SolverAnswer answer = solve(program, 1e-9);
  EXPECT_NE(answer.outcome, SolverOutcome::kOptimal);
}

TEST(CsdpSolver, ProvesInfeasibilityByADualPoint) {
  // x >= 1 and -x >= 0: X = (1, 1) makes tr(A X) = 0 and tr(C X) = 1.
  SemidefiniteProgram program;
  program.block_sizes = {1, 1};
  program.c = VectorXd::Ones(1);
  program.entries = {{0, 0, 0, 0, 1.0}, {-1, 0, 0, 0, 1.0}, {0, 1, 0, 0, -1.0}};
  const SolverAnswer answer = solve(program, 1e-9);
  ASSERT_EQ(answer.outcome, SolverOutcome::kInfeasible);
  ASSERT_EQ(answer.X.size(), 2U);
  EXPECT_NEAR(answer.X[0](0, 0) - answer.X[1](0, 0), 0.0, 1e-7 * answer.X[0](0, 0));
  EXPECT_GT(answer.X[0](0, 0), 0.0);
}

}  // namespace
}  // namespace faultline

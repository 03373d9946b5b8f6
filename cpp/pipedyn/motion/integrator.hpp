// SPDX-License-Identifier: MIT
//
// The base class of integrators of y' = f(t, y). Members of a batch advance together, each with
// steps of its own; the interpolant of an accepted step gives the samples within it.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "pipedyn/motion/charts.hpp"

namespace pipedyn {

/// The function f: from times (members,), states (rows, members) and the indices of these members
/// it computes rates (rows, members), which are NaN where they do not exist.
using Rates = std::function<void(const Vector& t, const double* y, const std::vector<Index>& which,
                                 double* rates)>;

/// Progress of the motion of a member.
enum class Progress { going, done, not_finite, vanishing, spent };

struct Member {
  double time = 0.0, step = 0.0, last_error = 1e-4;
  double beyond = 0.0;  // exact time less the rounded one
  Index samples = 0, evaluations = 0;
  bool rejected = false, overflowed = false;
  Progress progress = Progress::going;
};

/// Polynomial sum_i c_i x^i for the states within a step, with x = (t - from) / (to - from).
struct Interpolant {
  double from = 0.0, to = 0.0;
  Matrix coefficients{};  // c_i (degree + 1, rows); signs of charts may follow as constants
};

/// Tolerances and limits of the steps of each member.
struct Limits {
  Vector relative;  // relative tolerance of each member
  Matrix absolute;  // absolute tolerance of each entry of its state (rows, members)
  double most;      // largest number of evaluations of a member
  double max_step = std::numeric_limits<double>::infinity();
};

class Integrator {
 public:
  virtual ~Integrator() = default;

  /// Advances for some hundredths of a second or a given number of evaluations. Returns true once
  /// every member has failed or has its states at all times, which increase, in out (members,
  /// times, rows), all in their first charts. Each call must pass the same times and out. `steps`,
  /// for a single member, receives every step; the call then returns after `most_steps` of them.
  bool advance(const Vector& times, double* out, Index evaluations,
               std::vector<Interpolant>* steps = nullptr);
  static constexpr std::size_t most_steps = 64;

  /// Ends the motion of a member.
  void stop(Index member) { members_.at(member).progress = Progress::spent; }

  const std::vector<Member>& members() const { return members_; }
  /// State of a member that is still advancing, (rows,).
  virtual Vector state(Index member) const = 0;
  /// Replaces a state of a member by that in the first charts.
  void leave_charts(Index member, double* y) const {
    if (charts_) charts_->leave(member, y);
  }

 protected:
  /// charts: those in which the states advance and which the rates read, or null.
  Integrator(Index rows, Index members, double time, const Limits& limits,
             std::shared_ptr<Charts> charts);

  bool has_charts() const { return charts_ != nullptr; }
  /// Changes the charts of a member's state where they become singular, and returns whether it did.
  bool choose_charts(Index member, Vector& y) {
    return has_charts() && charts_->choose(member, y.data());
  }

  /// Tries a step of each advancing member, not beyond `end`. Returns the evaluations it took.
  virtual Index step(double end) = 0;
  /// Keeps only the given columns of which_.
  virtual void keep(const std::vector<Index>& columns) = 0;

  /// Safety factor: steps are this fraction of the size that the error allows.
  static constexpr double safety = 0.9;
  /// Time from a member's present to `end`.
  static double left(const Member& member, double end) { return end - member.time - member.beyond; }
  /// Size of the next step of a member, which does not pass `end`.
  double length(const Member& member, double end) const;
  /// Advances the time of a member by h in compensated summation, as many short steps are added to
  /// a large time. Plans the next step: no shorter than the planned one if `end` or max_step cut
  /// this.
  void move_on(Member& member, double h, double next, double end);
  /// Plans a shorter step after a failed one, or ends the motion if the time would not change.
  void shorten(Member& member, double h);

  /// Whether the step that a member has just taken contains a sample.
  bool is_asked_for(const Member& member) const;
  void record(Index member, const Interpolant& step);

  Index rows_;
  Limits limits_;
  std::vector<Member> members_;
  std::vector<Index> which_;  // members that are still advancing

 private:
  void drop_finished();

  std::shared_ptr<Charts> charts_;
  const Vector* times_ = nullptr;  // the times that were passed to `advance`
  double* out_ = nullptr;
  std::vector<Interpolant>* steps_ = nullptr;
  // For a sample: powers of x, what they multiply, and the factors of the sums, which are 1.
  Vector powers_, ones_;
  std::vector<const double*> terms_;
};

}  // namespace pipedyn

// SPDX-License-Identifier: MIT
//
// What integrators of y' = f(t, y) have in common: members that advance together, each with steps
// of its own, and the interpolant of an accepted step, from which samples are taken.
#pragma once

#include <functional>
#include <limits>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// f of times (members,) and states (rows, members), which of all members they are: writes rates
/// (rows, members), NaN where it has none.
using Rates = std::function<void(const Vector& t, const double* y, const std::vector<Index>& which,
                                 double* rates)>;

/// How a member's motion stands.
enum class Progress { going, done, not_finite, vanishing, spent };

struct Member {
  double time = 0.0, step = 0.0, last_error = 1e-4;
  double beyond = 0.0;  // by how much it is beyond the time, which is rounded
  Index samples = 0, evaluations = 0;
  bool rejected = false, overflowed = false;
  Progress progress = Progress::going;
};

/// States within a step, sum_i c_i x^i with x = (t - from) / (to - from).
struct Interpolant {
  double from = 0.0, to = 0.0;
  Matrix coefficients{};  // c_i (degree + 1, rows)
};

/// What the steps of each member keep to.
struct Limits {
  Vector relative;  // error of a step of each member
  Matrix absolute;  // and of each entry of its state (rows, members)
  double most;      // evaluations of a member
  double max_step = std::numeric_limits<double>::infinity();
};

class Integrator {
 public:
  virtual ~Integrator() = default;

  /// Goes on for some hundredths of a second or so many evaluations; true once every member has
  /// failed or has its states at all the times, increasing, in out (members, times, rows). The same
  /// times and out must be given each time. `steps`, for a single member, gets every step; then it
  /// returns after `most_steps` of them.
  bool advance(const Vector& times, double* out, Index evaluations,
               std::vector<Interpolant>* steps = nullptr);
  static constexpr std::size_t most_steps = 64;

  /// Ends a member's motion.
  void stop(Index member) { members_.at(member).progress = Progress::spent; }

  const std::vector<Member>& members() const { return members_; }
  /// Where a member that goes on is, (rows).
  virtual Vector state(Index member) const = 0;

 protected:
  Integrator(Index rows, Index members, double time, const Limits& limits);

  /// Tries a step of each member that goes on, not beyond `end`; the evaluations that one took.
  virtual Index step(double end) = 0;
  /// Goes on with these of the columns of which_.
  virtual void keep(const std::vector<Index>& columns) = 0;

  /// Steps are chosen this part as long as the error allows.
  static constexpr double safety = 0.9;
  /// From where a member is to an end.
  static double left(const Member& member, double end) { return end - member.time - member.beyond; }
  /// Length of a member's next step, which does not go beyond `end`.
  double length(const Member& member, double end) const;
  /// Moves a member on by a step h, so that many short ones at a large time add up. Plans the next:
  /// no shorter than was planned before where `end` or max_step cut this one.
  void move_on(Member& member, double h, double next, double end);
  /// Plans a shorter step instead of one that failed, or ends where time would not change.
  void shorten(Member& member, double h);

  /// Whether the step that a member has just taken, to its time, must be recorded.
  bool is_asked_for(const Member& member) const;
  void record(Index member, const Interpolant& step);

  Index rows_;
  Limits limits_;
  std::vector<Member> members_;
  std::vector<Index> which_;  // members that go on

 private:
  void drop_finished();

  const Vector* times_ = nullptr;  // as `advance` was asked
  double* out_ = nullptr;
  std::vector<Interpolant>* steps_ = nullptr;
};

}  // namespace pipedyn

// SPDX-License-Identifier: MIT
//
// Motions y' = f(t, y) by an explicit method of order 8 whose steps follow the error, each
// member of a batch with steps of its own; states at given times by dense output of order 7.
// O(rows) a step and member besides 12 evaluations of f, and 3 more where a sample is taken.
#pragma once

#include <functional>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// f of times (members,) and states (rows, members), which of all members they are: writes rates
/// (rows, members), NaN where it has none.
using Rates = std::function<void(const Vector& t, const double* y, const std::vector<Index>& which,
                                 double* rates)>;

/// How a member's motion stands.
enum class Progress { going, done, not_finite, vanishing, spent };

class Dop853 {
 public:
  /// start: (rows, members), all at time 0. A member takes at most `most` evaluations.
  Dop853(Rates rates, Index rows, Index members, const double* start, double relative,
         double absolute, double most);

  /// Goes on for some hundredths of a second, or so many evaluations, or until every member has
  /// failed or has its states at all the times, increasing, in out (members, times, rows); whether
  /// that is so. The same times and out must be given each time.
  bool advance(const Vector& times, double* out, Index evaluations);

  /// Ends a member's motion.
  void stop(Index member) { members_.at(member).progress = Progress::spent; }

  struct Member {
    double time = 0.0, step = 0.0, last_error = 1e-4;
    Index samples = 0, evaluations = 0;
    bool rejected = false, overflowed = false;
    Progress progress = Progress::going;
  };
  const std::vector<Member>& members() const { return members_; }

 private:
  Index active() const { return static_cast<Index>(which_.size()); }
  Index entries() const { return rows_ * active(); }
  void evaluate(const Vector& y, Vector& rates, double share);
  void combine(const double* weights, Index terms, const Vector& y, Vector& out);
  void choose_first_steps();
  void step(const Vector& times, double* out);
  void measure_errors();
  void control(Index j, double end);
  void sample(const Vector& times, double* out);
  void drop_finished();

  Rates rates_;
  Index rows_;
  double relative_, absolute_, most_;
  std::vector<Member> members_;
  std::vector<Index> which_;  // members that go on, by the columns of y
  Vector y_, next_, stage_, steps_, scaled5_, scaled3_;
  std::vector<Vector> rate_;  // of the 13 stages, in rows of active() entries, and of 3 more
  Vector tried_, error_, t_;  // by column
  std::vector<char> accepted_;
};

}  // namespace pipedyn

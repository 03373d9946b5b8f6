// SPDX-License-Identifier: MIT
//
// Divides the work of many members or intervals among the threads of the machine.
#pragma once

#include <algorithm>
#include <functional>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/pipe.hpp"
#include "pipedyn/util/threads.hpp"

namespace pipedyn {

/// Work on a batch, which writes its results.
using Work = std::function<void(const Batch&, double*)>;

/// Does the work on a batch of states (rows, members) in parts. results: numbers that it writes for
/// a member, as a column of (results, members) or, if of_member, one member after the other; each:
/// amount of work for one member.
inline void in_parts(const Batch& batch, Index rows, Index results, bool of_member, Index each,
                     const Work& work, double* out) {
  const Index members = batch.members;
  in_parts(members, each, [&](Index begin, Index end) {
    const Index count = end - begin;
    if (count == members) {
      work(batch, out);
      return;
    }
    const auto columns = [=](const double* of, Index height) -> Matrix {
      if (of == nullptr) return {};
      return Eigen::Map<const Matrix>(of, height, members).middleCols(begin, count);
    };
    const Matrix y = columns(batch.y, rows), drive = columns(batch.drive, Drive::rows);
    const Batch part{.y = y.data(),
                     .u = batch.u + begin * batch.u_step,
                     .members = count,
                     .u_step = batch.u_step,
                     .drive = batch.drive == nullptr ? nullptr : drive.data()};
    if (of_member) {
      work(part, out + begin * results);
      return;
    }
    Matrix found(results, count);
    work(part, found.data());
    Eigen::Map<Matrix>(out, results, members).middleCols(begin, count) = found;
  });
}

}  // namespace pipedyn

// SPDX-License-Identifier: MIT
//
// The recursion of one vector level. This source is compiled once for each, with PIPEDYN_LEVEL and
// PIPEDYN_WIDTH set.
#include "pipedyn/chain/impedance.hpp"

#include "pipedyn/vector/pack.hpp"

namespace {

using pipedyn::ImpedanceModel;
using pipedyn::ImpedancePairs;
using pipedyn::ImpedanceParts;
using pipedyn::ImpedancePoints;
using pipedyn::ImpedanceSegment;

/// A pack of complex numbers.
struct Lanes {
  Pack re{}, im{};
};

inline Lanes operator+(const Lanes& a, const Lanes& b) { return {a.re + b.re, a.im + b.im}; }
inline Lanes operator-(const Lanes& a, const Lanes& b) { return {a.re - b.re, a.im - b.im}; }
inline Lanes operator*(const Lanes& a, const Lanes& b) {
  return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}
inline Lanes operator*(double a, const Lanes& b) { return {a * b.re, a * b.im}; }
inline void operator+=(Lanes& a, const Lanes& b) { a = a + b; }
inline Lanes conjugate(const Lanes& a) { return {a.re, -a.im}; }
inline Lanes inverse(const Lanes& a) {
  const Pack share = 1.0 / (a.re * a.re + a.im * a.im);
  return {a.re * share, -a.im * share};
}
/// |Re| + |Im|, at least |a| and at most 1.5 times that.
inline Pack size_of(const Lanes& a) { return absolute(a.re) + absolute(a.im); }

/// What multiplies the parts of a segment's coefficients.
template <class Number>
struct Factors {
  Pack still;           // 1, or 0 in a derivative
  Number rate, square;  // lambda, lambda^2
  Number coriolis;      // sqrt(beta) U lambda
  double thrust;        // a U^2
};

template <class Number>
struct Coefficients {
  Number elastic, force, across, turned, moment;  // e k, z, f, t, g
  double thrust;                                  // a U^2
};

inline Lanes combined(const ImpedanceParts& part, const Factors<Lanes>& by) {
  Lanes sum = part.square * by.square + part.rate * by.rate;
  sum.re += part.still * by.still;
  return sum;
}
inline Pack combined(const ImpedanceParts& part, const Factors<Pack>& by) {
  return part.square * by.square + part.rate * by.rate + part.still * by.still;
}

template <class Number>
inline Coefficients<Number> coefficients(const ImpedanceSegment& at, const Factors<Number>& by) {
  const double l = at.length;
  return {combined(at.joint, by),
          combined(at.force, by),
          combined(at.across, by),
          combined(at.turned, by) + (2.0 * l) * by.coriolis,
          combined(at.moment, by) + (l * l) * by.coriolis,
          by.thrust};
}

/// Factors of T, its derivatives, and of the sizes of its entries' terms.
struct Problem {
  Factors<Lanes> whole, by_lambda, by_u;
  Factors<Pack> sizes;

  Problem() = default;
  Problem(const ImpedanceModel& model, const Lanes& lambda, double u) {
    const Pack one = all<Pack>(1.0), none{};
    const double c = model.coriolis, a = model.centrifugal;
    const Lanes unit{one, none}, zero{};
    whole = {one, lambda, lambda * lambda, (c * u) * lambda, a * u * u};
    by_lambda = {none, unit, 2.0 * lambda, (c * u) * unit, 0.0};
    by_u = {none, zero, zero, c * lambda, 2.0 * a * u};
    const Pack size = size_of(lambda);
    sizes = {one, size, size * size, std::fabs(c) * u * size, whole.thrust};
  }
};

/// How all beyond the end of a segment answers its motion.
struct Impedance {
  Lanes a, b, c, d;
};

/// What eliminates a segment.
struct Step {
  Lanes g, r, w, h, pushed, p;

  Step(double l, const Impedance& beyond, const Coefficients<Lanes>& at) {
    const Lanes carried = l * beyond.a;
    g = carried + beyond.b;
    r = at.moment + beyond.d + l * (beyond.c + g);
    w = at.across + beyond.c + carried;
    h = g + at.turned;
    pushed = h;
    pushed.re += at.thrust;
    p = at.elastic + r;
  }
};

/// Before a segment whose end is held; linear in what it takes.
inline Impedance before_held(double l, const Impedance& beyond, const Coefficients<Lanes>& at) {
  const double share = 1.0 / l;
  Impedance found;
  found.d = at.elastic;
  found.b = found.c = share * at.elastic;
  found.b.re -= all<Pack>(at.thrust);
  found.a =
      share * (share * (at.elastic + beyond.d + at.moment) - at.across - at.turned) + at.force;
  found.a.re -= all<Pack>(share * at.thrust);
  return found;
}

Lanes taken(const ImpedancePoints& points, Count first) {
  double re[width], im[width];
  for (Count i = 0; i < width; ++i) {  // the last stands in for what is missing
    const Count from = first + i < points.count ? first + i : points.count - 1;
    re[i] = points.real[from];
    im[i] = points.imag[from];
  }
  return {load<Pack>(re), load<Pack>(im)};
}

void put(double* out, const ImpedancePoints& points, Count first, const Pack& x) {
  double each[width];
  store(each, x);
  for (Count i = 0; i < width && first + i < points.count; ++i) out[first + i] = each[i];
}
void put(double* out, const ImpedancePoints& points, Count first, const Lanes& x) {
  put(out, points, first, x.re);
  put(out + points.count, points, first, x.im);
}

/// Packs that log_derivative takes through the segments together: each waits for its own divisions.
constexpr Count abreast = 4;

void log_derivative(const ImpedanceModel& model, const ImpedancePoints& points, double* out) {
  for (Count first = 0; first < points.count; first += abreast * width) {
    const Count left = (points.count - first + width - 1) / width;
    const Count packs = left < abreast ? left : abreast;
    Problem problems[abreast];
    Impedance before[abreast], rates[abreast];  // and its derivative by lambda
    Lanes sums[abreast];
    for (Count p = 0; p < packs; ++p) {
      const Lanes lambda = taken(points, first + p * width);
      problems[p] = Problem(model, lambda, points.u);
      Lanes& sum = sums[p];
      for (Count k = 0; k < points.roots; ++k) {
        const Pack x = lambda.re - points.root_real[k], y = lambda.im - points.root_imag[k];
        const Pack square = x * x + y * y,
                   share = 1.0 / (square > 1e-300 ? square : all<Pack>(1e-300));
        sum.re -= x * share;
        sum.im += y * share;
      }
    }
    for (Count j = model.size - 1; j >= 0; --j) {
      const ImpedanceSegment& segment = model.segments[j];
      for (Count p = 0; p < packs; ++p) {
        const Problem& problem = problems[p];
        Impedance &at = before[p], &by = rates[p];
        const auto own = coefficients(segment, problem.whole);
        const auto change = coefficients(segment, problem.by_lambda);
        if (segment.held) {  // its pivot is constant
          by = before_held(segment.length, by, change);
          at = before_held(segment.length, at, own);
          continue;
        }
        const Step step(segment.length, at, own), moved(segment.length, by, change);
        const Lanes share = inverse(step.p), relative = moved.p * share;
        sums[p] += relative;
        const Lanes w = step.w * share, r = step.r * share, e = own.elastic * share;
        const Lanes dw = moved.w * share - w * relative, dr = moved.r * share - r * relative,
                    de = change.elastic * share - e * relative;
        by = {by.a + change.force - (moved.h * w + step.pushed * dw),
              moved.h * e + step.h * de - own.thrust * dr, change.elastic * w + own.elastic * dw,
              change.elastic * r + own.elastic * dr};
        at = {at.a + own.force - step.pushed * w, step.h * e - own.thrust * r, own.elastic * w,
              own.elastic * r};
      }
    }
    for (Count p = 0; p < packs; ++p) put(out, points, first + p * width, sums[p]);
  }
}

/// Joint angle, angle, and displacement of a segment's joint and end.
struct Motion {
  Lanes turn, angle, joint, end;

  /// From the segment before and what loads turn this one by, none by a difference of the others.
  /// by_joint: W of the step, or H for the left vector; by_end: p - l by_joint.
  void move(double l, const Lanes& share, const Lanes& elastic, const Lanes& r,
            const Lanes& by_joint, const Lanes& by_end, const Lanes& loaded) {
    joint = end;
    turn = loaded - (r * angle + by_joint * joint) * share;
    end = l * loaded + (by_end * joint + l * (elastic * angle)) * share;
    angle = loaded + (elastic * angle - by_joint * joint) * share;
  }
  /// The same where the end is held.
  void move_to_guide(double l) {
    joint = end;
    end = {};
    turn = (-1.0 / l) * joint - angle;
    angle = (-1.0 / l) * joint;
  }
};

/// Of loads on all beyond a segment: the force and the moment that they add to its impedance, and
/// by what angle they turn it.
struct LoadBeyond {
  Lanes force, moment, turned;
};

/// What a motion's forces do in a virtual one on one segment.
inline Lanes work(const Coefficients<Lanes>& at, const Motion& virtual_, const Motion& motion) {
  return at.elastic * (virtual_.turn * motion.turn) +
         virtual_.angle * (at.moment * motion.angle + at.across * motion.joint) +
         virtual_.joint *
             (at.force * motion.joint + at.turned * motion.angle + at.thrust * motion.turn);
}

/// What the way back needs of a segment: the impedance of all beyond, 1 / p, and what the loads of
/// right and left vector turn it by.
struct Segment {
  Impedance beyond;
  Lanes share, load, dual;
};

void pairs(const ImpedanceModel& model, const ImpedancePoints& points, const ImpedancePairs& out,
           double* scratch) {
  const Count n = model.size;
  Count start = 0;  // the first segment that moves
  while (model.segments[start].held) ++start;
  Segment* const segments = reinterpret_cast<Segment*>(scratch);
  for (Count first = 0; first < points.count; first += width) {
    const Problem problem(model, taken(points, first), points.u);
    Impedance at;
    LoadBeyond load, dual;
    double part = 0.5;
    for (Count j = n - 1; j >= 0; --j) {
      const ImpedanceSegment& segment = model.segments[j];
      const double l = segment.length;
      const auto own = coefficients(segment, problem.whole);
      if (segment.held) {  // the guide takes forces, and moments as forces
        segments[j].beyond = at;
        at = before_held(l, at, own);
        load = {(-1.0 / l) * load.moment, {}, {}};
        dual = {(-1.0 / l) * dual.moment, {}, {}};
        continue;
      }
      const Step step(l, at, own);
      const Lanes share = inverse(step.p), e = own.elastic * share;
      if (out.loaded) {
        const Lanes moment{part * (size_of(own.elastic) + size_of(own.moment)), {}};
        load.turned = (moment - load.moment - l * load.force) * share;
        dual.turned = (moment - dual.moment - l * dual.force) * share;
        load.force += step.pushed * load.turned;
        dual.force += step.w * dual.turned;
        load.moment = Lanes{} - own.elastic * load.turned;
        dual.moment = Lanes{} - own.elastic * dual.turned;
        part += part < 1.0 ? 0.382 : -0.618;  // in no order
      }
      segments[j] = {at, share, load.turned, dual.turned};
      at = {at.a + own.force - step.pushed * (step.w * share),
            step.h * e - own.thrust * (step.r * share), step.w * e, step.r * e};
    }
    const Lanes free{all<Pack>(out.loaded ? 0.0 : 1.0), {}};  // 1 / p may be infinite
    Motion x, y;
    Lanes value, by_lambda, by_u, by_right, missing, force_before;
    Pack rest{}, entries{}, sums{};
    for (Count j = 0; j < start; ++j) {
      if (out.right != nullptr) put(out.right + 2 * j * points.count, points, first, x.turn);
      if (out.left != nullptr) put(out.left + 2 * j * points.count, points, first, y.turn);
    }
    for (Count j = start; j < n; ++j) {
      const ImpedanceSegment& segment = model.segments[j];
      const double l = segment.length;
      const auto own = coefficients(segment, problem.whole);
      const auto change = coefficients(segment, problem.by_lambda);
      const auto terms = coefficients(model.sizes[j], problem.sizes);
      const auto& [at, share, load_of, dual_of] = segments[j];
      const Motion x_before = x, y_before = y;
      const Step step(l, at, own);
      const Lanes rest_of_p = own.elastic + own.moment + at.d;
      const Lanes pressed{all<Pack>(l * own.thrust), {}};
      if (segment.held) {
        x.move_to_guide(l);
        y.move_to_guide(l);
      } else if (j == start) {
        x.turn = x.angle = out.loaded ? load_of : free;
        y.turn = y.angle = out.loaded ? dual_of : free;
        x.end = l * x.turn;
        y.end = l * y.turn;
      } else {
        x.move(l, share, own.elastic, step.r, step.w, rest_of_p + l * (at.b - own.across), load_of);
        y.move(l, share, own.elastic, step.r, step.pushed,
               rest_of_p + l * (at.c - own.turned) - pressed, dual_of);
      }
      by_lambda += work(change, y, x);
      by_u += work(coefficients(segment, problem.by_u), y, x);
      const Motion mirrored{conjugate(x.turn), conjugate(x.angle), conjugate(x.joint), {}};
      by_right += work(change, mirrored, x);
      // |Y|^T |T X|; the joint's moment of the segment before is complete now.
      const Lanes elastic = own.elastic * x.turn;
      const Lanes dual_moment = own.elastic * y.turn + own.thrust * y.joint;
      Lanes force = at.a * x.end + at.b * x.angle, dual_force = at.a * y.end + at.c * y.angle;
      if (segment.held) {  // with the guide's
        const Lanes turned = own.moment + at.d;
        force = (-1.0 / l) * (elastic + turned * x.angle + own.across * x.joint);
        dual_force = (-1.0 / l) * (dual_moment + turned * y.angle + own.turned * y.joint);
      }
      const Pack held = size_of(dual_moment), pulled = size_of(dual_force),
                 joint = size_of(y.joint), angle = size_of(y.angle);
      const auto add = [&](const Lanes& dual_row, const Lanes& row) {
        value += dual_row * row;
        rest += size_of(dual_row) * size_of(row);
      };
      add(y_before.angle, missing - elastic);
      add(dual_moment, x.angle - x_before.angle - x.turn);
      add(Lanes{} - dual_force, x.end - x.joint - l * x.angle);
      if (j > start) {
        add(y.joint, own.force * x.joint + own.turned * x.angle + own.thrust * x.turn + force -
                         force_before);
      }
      missing = elastic + own.moment * x.angle + own.across * x.joint + l * force;
      // What Y^T T X sums, and what theta, w and their duals are sums of.
      const Pack turns = size_of(x.turn), angles = size_of(x.angle), joints = size_of(x.joint);
      entries += terms.elastic * size_of(y.turn) * turns +
                 angle * (terms.moment * angles + terms.across * joints) +
                 joint * (terms.force * joints + terms.turned * angles + terms.thrust * turns);
      sums += held * (turns + angles + size_of(x_before.angle)) +
              pulled * (size_of(x.end) + joints + l * angles) +
              size_of(elastic) * (angle + size_of(y_before.angle)) +
              size_of(force) * (joint + size_of(y.end));
      force_before = force;
      if (out.right != nullptr) put(out.right + 2 * j * points.count, points, first, x.turn);
      if (out.left != nullptr) put(out.left + 2 * j * points.count, points, first, y.turn);
    }
    value += y.angle * missing;
    rest += size_of(y.angle) * size_of(missing);
    put(out.value, points, first, value);
    put(out.by_lambda, points, first, by_lambda);
    put(out.by_u, points, first, by_u);
    put(out.by_right, points, first, by_right);
    put(out.rest, points, first, rest);
    put(out.entries, points, first, entries);
    put(out.sums, points, first, sums);
  }
}

}  // namespace

namespace pipedyn {

const ImpedanceKernel PIPEDYN_NAMED(impedance) = {.log_derivative = ::log_derivative,
                                                  .pairs = ::pairs};

}  // namespace pipedyn

// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin_kernel.hpp"

#include <cmath>

namespace pipedyn {

namespace {

#if defined(__AVX512F__)
constexpr ptrdiff_t lanes = 8;
#elif defined(__AVX__)
constexpr ptrdiff_t lanes = 4;
#else
constexpr ptrdiff_t lanes = 2;
#endif
// One register; may be read from and written to any array of doubles.
using Lanes = double __attribute__((vector_size(8 * lanes), aligned(8), may_alias));
using Pair = double __attribute__((vector_size(16), aligned(8), may_alias));

// The place for a vectorised sine and cosine.
void sine_cosine(ptrdiff_t count, const double* angle, double* sine, double* cosine) {
  for (ptrdiff_t i = 0; i < count; ++i) {
    sine[i] = std::sin(angle[i]);
    cosine[i] = std::cos(angle[i]);
  }
}

// Four rows and `columns` registers of out = integral x.
template <class Register, int columns>
inline void product_tile(ptrdiff_t depth, const double* integral, const double* x,
                         ptrdiff_t row_length, double* out) {
  constexpr int rows = 4;
  Register sum[rows][columns] = {};
  for (ptrdiff_t q = 0; q < depth; ++q, x += row_length) {
    const auto* values = reinterpret_cast<const Register*>(x);
    for (int r = 0; r < rows; ++r) {
      const double factor = integral[r * depth + q];
      for (int c = 0; c < columns; ++c) sum[r][c] += factor * values[c];
    }
  }
  for (int r = 0; r < rows; ++r) {
    auto* values = reinterpret_cast<Register*>(out + r * row_length);
    for (int c = 0; c < columns; ++c) values[c] = sum[r][c];
  }
}

// out (Q + 1, row_length) = integral (Q + 1, Q) x (Q, row_length); row_length a multiple of 4.
void integrate(const LevelTables& level, const double* x, ptrdiff_t row_length, double* out) {
  const ptrdiff_t points = level.nodes + 1;
  for (ptrdiff_t p = 0; p < points; p += LevelTables::multiple) {
    const double* integral = level.integral + p * level.nodes;
    double* rows = out + p * row_length;
    ptrdiff_t c = 0;
    for (; c + 2 * lanes <= row_length; c += 2 * lanes) {
      product_tile<Lanes, 2>(level.nodes, integral, x + c, row_length, rows + c);
    }
    for (; c < row_length; c += 4) {
      product_tile<Pair, 2>(level.nodes, integral, x + c, row_length, rows + c);
    }
  }
}

// Lower triangle of the mass matrix in tiles: sum over nodes and both components of w J_i J_j.
// One member: registers run over j. A block: registers run over the members.
template <ptrdiff_t width>
void gram(const LevelTables& level, const double* j, ptrdiff_t row_length, double* mass) {
  const ptrdiff_t padded = level.padded;
  const double* weight = level.integral + level.nodes * level.nodes;
  if constexpr (width == 1) {
    constexpr int rows = 4;
    for (ptrdiff_t i = 0; i < padded; i += rows) {
      for (ptrdiff_t k = 0; k <= i; k += 4) {
        Pair sum[rows][2] = {};
        for (ptrdiff_t p = 0; p < level.nodes; ++p) {
          for (ptrdiff_t component = 0; component < 2; ++component) {
            const double* row = j + p * row_length + component * padded;
            const auto* other = reinterpret_cast<const Pair*>(row + k);
            const Pair first = weight[p] * other[0], second = weight[p] * other[1];
            for (int r = 0; r < rows; ++r) {
              sum[r][0] += row[i + r] * first;
              sum[r][1] += row[i + r] * second;
            }
          }
        }
        for (int r = 0; r < rows; ++r) {
          auto* out = reinterpret_cast<Pair*>(mass + (i + r) * padded + k);
          out[0] = sum[r][0];
          out[1] = sum[r][1];
        }
      }
    }
  } else {
    constexpr ptrdiff_t size = lanes == 8 ? 4 : 2;  // of a tile, so that it stays in registers
    for (ptrdiff_t lane = 0; lane < width; lane += lanes) {
      for (ptrdiff_t i = 0; i < padded; i += size) {
        for (ptrdiff_t k = 0; k <= i; k += size) {
          Lanes sum[size][size] = {};
          for (ptrdiff_t p = 0; p < level.nodes; ++p) {
            for (ptrdiff_t component = 0; component < 2; ++component) {
              const double* row = j + p * row_length + component * padded * width + lane;
              for (ptrdiff_t r = 0; r < size; ++r) {
                const Lanes value =
                    weight[p] * *reinterpret_cast<const Lanes*>(row + (i + r) * width);
                for (ptrdiff_t c = 0; c < size; ++c) {
                  sum[r][c] += value * *reinterpret_cast<const Lanes*>(row + (k + c) * width);
                }
              }
            }
          }
          for (ptrdiff_t r = 0; r < size; ++r) {
            for (ptrdiff_t c = 0; c < size; ++c) {
              *reinterpret_cast<Lanes*>(mass + ((i + r) * padded + k + c) * width + lane) =
                  sum[r][c];
            }
          }
        }
      }
    }
  }
}

// mass x = force by Cholesky's factors, in place; a negative pivot leaves NaN.
template <ptrdiff_t width>
void solve(ptrdiff_t m, ptrdiff_t row_length, double* mass, const double* force, double* x) {
  const auto at = [&](ptrdiff_t i, ptrdiff_t j) { return mass + (i * row_length + j) * width; };
  for (ptrdiff_t i = 0; i < m; ++i) {
    double rest[width];
    for (ptrdiff_t b = 0; b < width; ++b) rest[b] = force[i * width + b];
    for (ptrdiff_t j = 0; j <= i; ++j) {
      double* entry = at(i, j);
      double sum[width];
      for (ptrdiff_t b = 0; b < width; ++b) sum[b] = entry[b];
      for (ptrdiff_t k = 0; k < j; ++k) {
        const double *left = at(i, k), *right = at(j, k);
        for (ptrdiff_t b = 0; b < width; ++b) sum[b] -= left[b] * right[b];
      }
      if (j < i) {
        const double* inverse = at(j, j);
        for (ptrdiff_t b = 0; b < width; ++b) {
          entry[b] = sum[b] * inverse[b];
          rest[b] -= entry[b] * x[j * width + b];
        }
      } else {
        for (ptrdiff_t b = 0; b < width; ++b) entry[b] = 1.0 / std::sqrt(sum[b]);
      }
    }
    for (ptrdiff_t b = 0; b < width; ++b) x[i * width + b] = rest[b] * at(i, i)[b];
  }
  for (ptrdiff_t i = m - 1; i >= 0; --i) {
    for (ptrdiff_t b = 0; b < width; ++b) x[i * width + b] *= at(i, i)[b];
    for (ptrdiff_t j = 0; j < i; ++j) {
      const double* entry = at(i, j);
      for (ptrdiff_t b = 0; b < width; ++b) x[j * width + b] -= entry[b] * x[i * width + b];
    }
  }
}

template <ptrdiff_t width>
struct Block {
  const LevelTables& level;
  const MotionEffects& effects;
  const ptrdiff_t m = level.functions, padded = level.padded, nodes = level.nodes;
  const ptrdiff_t points = nodes + 1;
  // A row holds, of each member side by side: the derivatives J_i of the position by the
  // orthonormal coordinates (x, then y), the acceleration at q'' = 0, the velocity.
  const ptrdiff_t row_length = (2 * padded + 4) * width;
  double *theta = nullptr, *omega = nullptr, *sine = nullptr, *cosine = nullptr;
  double *integrand = nullptr, *jacobian = nullptr, *mass = nullptr;
  double *velocity = nullptr, *weighted = nullptr, *scratch = nullptr;

  /// Doubles used; without work it only counts them.
  ptrdiff_t lay_out(double* work) {
    ptrdiff_t used = 0;
    const auto take = [work, &used](ptrdiff_t count) {
      double* start = work ? work + used : nullptr;
      used += (count + 7) / 8 * 8;
      return start;
    };
    theta = take(points * width);
    omega = take(points * width);
    sine = take(points * width);
    cosine = take(points * width);
    integrand = take(nodes * row_length);
    jacobian = take(points * row_length);
    mass = take(padded * padded * width);
    velocity = take(points * width);
    weighted = take(points * width);
    scratch = take(3 * nodes);
    return used;
  }

  void angles(const double* q, const double* rate) {
    for (ptrdiff_t p = 0; p < points * width; ++p) theta[p] = omega[p] = 0.0;
    for (ptrdiff_t i = 0; i < m; ++i) {
      const double* slope = level.slope_by_function + i * points;
      const double *amplitude = q + i * width, *speed = rate + i * width;
      for (ptrdiff_t p = 0; p < points; ++p) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          theta[p * width + b] += slope[p] * amplitude[b];
          omega[p * width + b] += slope[p] * speed[b];
        }
      }
    }
    sine_cosine(points * width, theta, sine, cosine);
  }

  void fill_integrand() {
    for (ptrdiff_t p = 0; p < nodes; ++p) {
      const double *s = sine + p * width, *c = cosine + p * width, *w = omega + p * width;
      const double* slope = level.orthonormal + p * padded;
      double *x = integrand + p * row_length, *y = x + padded * width, *bias = y + padded * width;
      for (ptrdiff_t i = 0; i < padded; ++i) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          x[i * width + b] = c[b] * slope[i];
          y[i * width + b] = -s[b] * slope[i];
        }
      }
      for (ptrdiff_t b = 0; b < width; ++b) {
        bias[b] = -s[b] * w[b] * w[b];
        bias[width + b] = -c[b] * w[b] * w[b];
        bias[2 * width + b] = c[b] * w[b];
        bias[3 * width + b] = -s[b] * w[b];
      }
    }
  }

  /// Signed weights times kappa v_n^2, and nothing else of the drag: shape (nodes, width).
  void drag() {
    for (ptrdiff_t p = 0; p < points; ++p) {
      const double* v = jacobian + p * row_length + (2 * padded + 2) * width;
      for (ptrdiff_t b = 0; b < width; ++b) {
        velocity[p * width + b] = cosine[p * width + b] * v[b] - sine[p * width + b] * v[width + b];
      }
    }
    for (ptrdiff_t b = 0; b < width; ++b) {
      signed_weights(level, velocity + b, width, scratch, weighted + b);
    }
    for (ptrdiff_t p = 0; p < nodes * width; ++p) {
      weighted[p] *= effects.drag * velocity[p] * velocity[p];
    }
  }

  void forces(const double* q, const double* rate, const double* u, double* force) {
    const double* weight = level.integral + nodes * nodes;
    bool flows = false;
    for (ptrdiff_t b = 0; b < width; ++b) flows = flows || u[b] != 0.0;
    const bool coriolis = flows && effects.coriolis != 0.0;
    if (effects.drag != 0.0) drag();
    for (ptrdiff_t i = 0; i < padded * width; ++i) force[i] = 0.0;
    for (ptrdiff_t p = 0; p < nodes; ++p) {
      const double *s = sine + p * width, *c = cosine + p * width;
      const double *x = jacobian + p * row_length, *y = x + padded * width;
      const double* bias = y + padded * width;
      double fx[width], fy[width];
      for (ptrdiff_t b = 0; b < width; ++b) {
        fx[b] = -weight[p] * bias[b];
        fy[b] = weight[p] * (effects.gamma - bias[width + b]);
      }
      if (coriolis) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          const double along = weight[p] * effects.coriolis * u[b] * omega[p * width + b];
          fx[b] -= along * c[b];
          fy[b] += along * s[b];
        }
      }
      if (effects.drag != 0.0) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          fx[b] -= weighted[p * width + b] * c[b];
          fy[b] += weighted[p * width + b] * s[b];
        }
      }
      for (ptrdiff_t i = 0; i < padded; ++i) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          force[i * width + b] += x[i * width + b] * fx[b] + y[i * width + b] * fy[b];
        }
      }
    }
    if (flows && effects.centrifugal != 0.0) {
      const double *x = jacobian + nodes * row_length, *y = x + padded * width;
      for (ptrdiff_t i = 0; i < m; ++i) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          force[i * width + b] -= effects.centrifugal * u[b] * u[b] *
                                  (sine[nodes * width + b] * x[i * width + b] +
                                   cosine[nodes * width + b] * y[i * width + b]);
        }
      }
    }
    double elastic[width];
    for (ptrdiff_t i = 0; i < m; ++i) {
      for (ptrdiff_t b = 0; b < width; ++b) elastic[b] = level.stiffness[i] * q[i * width + b];
      if (effects.damping != 0.0) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          elastic[b] += effects.damping * level.stiffness[i] * rate[i * width + b];
        }
      }
      if (!level.to_basis) {
        for (ptrdiff_t b = 0; b < width; ++b) force[i * width + b] -= elastic[b];
        continue;
      }
      for (ptrdiff_t j = i; j < m; ++j) {
        const double factor = level.to_basis[i * m + j];
        for (ptrdiff_t b = 0; b < width; ++b) force[j * width + b] -= factor * elastic[b];
      }
    }
  }

  /// From orthonormal coordinates to the basis, in place.
  void to_basis(double* x) const {
    for (ptrdiff_t i = 0; i < m; ++i) {
      double sum[width] = {};
      for (ptrdiff_t j = i; j < m; ++j) {
        for (ptrdiff_t b = 0; b < width; ++b) {
          sum[b] += level.to_basis[i * m + j] * x[j * width + b];
        }
      }
      for (ptrdiff_t b = 0; b < width; ++b) x[i * width + b] = sum[b];
    }
  }

  void run(const double* q, const double* rate, const double* u, double* acceleration) {
    angles(q, rate);
    fill_integrand();
    integrate(level, integrand, row_length, jacobian);
    double* force = integrand;  // no longer needed
    forces(q, rate, u, force);
    gram<width>(level, jacobian, row_length, mass);
    solve<width>(m, padded, mass, force, acceleration);
    if (level.to_basis) to_basis(acceleration);
  }
};

template <ptrdiff_t width>
Block<width> block_of(const LevelTables& level, const MotionEffects& effects) {
  return Block<width>{.level = level, .effects = effects};
}

}  // namespace

ptrdiff_t work_size(const LevelTables& level, ptrdiff_t width) {
  const MotionEffects none{};
  if (width == 1) return block_of<1>(level, none).lay_out(nullptr);
  return block_of<block_width>(level, none).lay_out(nullptr);
}

void accelerations(const LevelTables& level, const MotionEffects& effects, ptrdiff_t width,
                   const double* q, const double* rate, const double* u, double* work,
                   double* acceleration) {
  if (width == 1) {
    auto block = block_of<1>(level, effects);
    block.lay_out(work);
    block.run(q, rate, u, acceleration);
  } else {
    auto block = block_of<block_width>(level, effects);
    block.lay_out(work);
    block.run(q, rate, u, acceleration);
  }
}

}  // namespace pipedyn

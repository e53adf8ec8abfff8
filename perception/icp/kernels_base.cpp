#include <immintrin.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "perception/icp/kernels.hpp"

namespace perception::icp {
namespace {
#include "perception/icp/kernels.inl"
}  // namespace

const Kernels kBaseKernels{"base",        accumulate_row, accumulate_row_cross,
                           bilateral_row, normal_row,     to_metres_row,
                           half_row};

}  // namespace perception::icp

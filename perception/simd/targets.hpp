// What the kernels are compiled for; included before any header of highway. One version each of 4,
// 8 and 16 lanes; the others highway knows differ in nothing that is used here.
#pragma once

#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif

#include "depth.h"

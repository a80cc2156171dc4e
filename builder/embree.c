#include "embree.h"

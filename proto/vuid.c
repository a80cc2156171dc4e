#include "vuid.h"

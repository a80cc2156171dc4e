#include "primitive.h"

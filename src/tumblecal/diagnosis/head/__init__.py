"""Many units measured on one head: is an error the head's, shared by all of them, or each unit's own?"""

from tumblecal.diagnosis.head.joint import Joint as Joint
from tumblecal.diagnosis.head.joint import joint as joint
